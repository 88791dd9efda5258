"""Records of findings that are no single figure, by what they are about; `details` lists them all."""
