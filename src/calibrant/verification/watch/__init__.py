"""Has the camera been moved while it works: picture after picture against the calibration, with stated false alarms."""
