"""Control laws: from features seen and wanted to an error and how the camera's motion changes it. One file a law."""
