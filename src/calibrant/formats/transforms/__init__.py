"""One transform as other programs take it: publishers and launch files of ROS, joints, calibration files, poses."""
