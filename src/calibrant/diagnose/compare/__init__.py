"""Two results compared: cameras in pixels over the image, transforms in millimetres and degrees, with sigma."""
