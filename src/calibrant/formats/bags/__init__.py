"""Recordings of robots: ROS 1 and ROS 2 bags, read without ROS. Their pictures are frames, as a video's are."""
