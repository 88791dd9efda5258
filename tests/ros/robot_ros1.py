"""A robot for roscore: publishes the pictures and transforms of a folder, and writes down what comes on /tf_static.

    /usr/bin/python3 robot_ros1.py FOLDER

FOLDER holds stands.npz (pictures (n, h, w), poses (n, 4, 4) as xyz and xyzw (n, 7), lens). It stands a second at each
place, jumps to the next one, and begins anew until the transform has come, which it prints as JSON.
"""

import json
import sys
from pathlib import Path

import numpy as np
import rospy
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

RATE_HZ = 20
PER_STAND = 24
found = []
shown = []


def heard(message):
    for one in message.transforms:
        t, q = one.transform.translation, one.transform.rotation
        place = [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
        found.append({"parent": one.header.frame_id, "child": one.child_frame_id, "place": place})


def main(folder):
    data = np.load(folder / "stands.npz")
    rospy.init_node("robot")
    image = rospy.Publisher("/wrist/image", Image, queue_size=2)
    lens = rospy.Publisher("/wrist/camera_info", CameraInfo, queue_size=2)
    tf = rospy.Publisher("/tf", TFMessage, queue_size=20)
    rospy.Subscriber("/tf_static", TFMessage, heard)
    rospy.Subscriber("/calibrant/wrist/samples", Image, lambda m: shown.append((m.width, m.height, m.encoding)))
    rate = rospy.Rate(RATE_HZ)
    step = 0
    while not found and not rospy.is_shutdown():
        n = (step // PER_STAND) % len(data["places"])
        now = rospy.Time.now()
        moved = TransformStamped()
        moved.header.stamp, moved.header.frame_id, moved.child_frame_id = now, "base", "tool0"
        t, q = moved.transform.translation, moved.transform.rotation
        (t.x, t.y, t.z, q.x, q.y, q.z, q.w) = (float(v) for v in data["places"][n])
        tf.publish(TFMessage([moved]))
        if step % 4 == 0:
            picture = data["pictures"][n]
            message = Image(height=picture.shape[0], width=picture.shape[1], encoding="mono8", step=picture.shape[1])
            message.header.stamp, message.header.frame_id, message.data = now, "wrist_optical", picture.tobytes()
            info = CameraInfo(height=picture.shape[0], width=picture.shape[1], distortion_model="plumb_bob")
            info.header, info.D, info.K = message.header, data["D"].tolist(), data["K"].ravel().tolist()
            lens.publish(info)
            image.publish(message)
        step += 1
        rate.sleep()
    sys.stdout.write(json.dumps({"static": found, "shown": shown[-1:]}) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
