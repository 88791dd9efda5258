"""ROS camera_info: YAML, what topics print, the old ini, pairs in two files, and camera_calibration's archive."""
