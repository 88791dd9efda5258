"""What a projector's patterns say of a scene."""
