"""Readers of bags that are not ours, for the tests of what is exported to ROS."""

import numpy as np


def messages_of(path):
    """Log times and messages of a bag by topic."""
    from rosbags.highlevel import AnyReader

    topics = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, raw in reader.messages():
            topics.setdefault(connection.topic, []).append((time_ns, reader.deserialize(raw, connection.msgtype)))
    return topics


def decoded(path):
    """Log times and messages by topic, as the packages mcap and mcap-ros2-support read them."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    topics = {}
    with path.open("rb") as file:
        for _, channel, message, content in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time, content))
    return topics


def vectors(messages, get):
    return np.array([[(v := get(m)).x, v.y, v.z] for _, m in messages])
