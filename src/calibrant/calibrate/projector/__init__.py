"""A projector beside a camera: an inverse camera, found in one problem with it."""
