"""Reads a recording with the ROS 2 messages of rosbags."""

import json
import sys
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader  # pyright: ignore[reportMissingImports]

found = {"topics": {}, "clouds": {}, "transforms": {}, "objects": {}}
found |= {"calibrations": {}, "fixes": {}}
with AnyReader([Path(sys.argv[1])]) as reader:
    for one in reader.connections:
        found["topics"][one.topic] = [one.msgtype, one.msgcount]
    for one, time_ns, raw in reader.messages():
        message = reader.deserialize(raw, one.msgtype)
        time = str(time_ns)
        if one.msgtype == "sensor_msgs/msg/PointCloud2":
            table = np.frombuffer(message.data, np.uint8).reshape(message.width, -1)
            offsets = {field.name: (field.offset, field.datatype) for field in message.fields}
            assert offsets["x"] == (0, 7)  # float32
            places = table[:, :12].copy().view("<f4")
            summary = [len(places), places.astype(float).sum(axis=0).tolist()]
            found["clouds"].setdefault(one.topic, {})[time] = [*summary, message.header.frame_id]
        elif one.msgtype == "sensor_msgs/msg/CameraInfo":
            calibration = [message.distortion_model, message.d.tolist()]
            found["calibrations"][one.topic] = calibration
        elif one.msgtype == "sensor_msgs/msg/NavSatFix":
            variances = message.position_covariance.tolist()
            found["fixes"][one.topic] = [message.position_covariance_type, variances]
        elif one.msgtype == "tf2_msgs/msg/TFMessage":
            for item in message.transforms:
                at, turn = item.transform.translation, item.transform.rotation
                numbers = [at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z]
                found["transforms"].setdefault(item.child_frame_id, {})[time] = numbers
        elif one.msgtype == "vision_msgs/msg/Detection3DArray":
            for item in message.detections:
                at, size = item.bbox.center.position, item.bbox.size
                kind = item.results[0].hypothesis.class_id
                numbers = [at.x, at.y, at.z, size.x, size.y, size.z]
                found["objects"].setdefault(item.id, {})[time] = [kind, *numbers]
print(json.dumps(found))
