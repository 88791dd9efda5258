"""A camera and a projector whose truth is known: points that one carries to the other, and pictures of what is lit."""
