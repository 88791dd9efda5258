"""The node: a skin over `calibrant.tasks.live` that brings it ROS's topics and publishes what it finds.

calibrant and ROS run in two processes, as ROS belongs to the system's Python: `side.py` alone imports rospy or rclpy.
"""
