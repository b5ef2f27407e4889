"""Reads MCAP files as a viewer does: with the `mcap` library, and by the schemas in the file."""

import json
from contextlib import suppress
from functools import cache

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from scipy.spatial.transform import Rotation


@cache
def messages(path, topic):
    """Time in nanoseconds and data of each message of a channel."""
    with path.open("rb") as file:
        return [(m.log_time, m.data) for _, _, m in make_reader(file).iter_messages(topics=[topic])]


@cache
def numbers(path, topic):
    """The messages of a channel of JSON, each with its time in nanoseconds."""
    return [(at, json.loads(data)) for at, data in messages(path, topic)]


def column(path, topic, name):
    """One field of a channel of JSON over time; NaN for null."""
    return np.array([np.nan if m[name] is None else m[name] for _, m in numbers(path, topic)])


@cache
def message_class(encoded_schema, name):
    pool = descriptor_pool.DescriptorPool()
    for each in descriptor_pb2.FileDescriptorSet.FromString(encoded_schema).file:
        pool.Add(each)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


@cache
def decoded(path, topic):
    """The messages of a channel with a Foxglove schema, each with its time in nanoseconds."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    channel = next(c for c in summary.channels.values() if c.topic == topic)
    schema = summary.schemas[channel.schema_id]
    kind = message_class(schema.data, schema.name)
    return [(at, kind.FromString(data)) for at, data in messages(path, topic)]


def entities(path):
    """Updates of each scene entity, by name."""
    found = {}
    for _, update in decoded(path, "/scene"):
        for entity in update.entities:
            found.setdefault(entity.id, []).append(entity)
    return found


def placed(frames, child):
    """Origin and orientation of a frame in the base, by composition of transforms."""
    by_name = {each.child_frame_id: each for each in frames}
    at_m, turn = np.zeros(3), Rotation.identity()
    while child in by_name:
        each = by_name[child]
        q, shift = each.rotation, each.translation
        own = Rotation.from_quat([q.x, q.y, q.z, q.w])
        at_m, turn = own.apply(at_m) + np.array([shift.x, shift.y, shift.z]), own * turn
        child = each.parent_frame_id
    assert child == "base"
    return at_m, turn


def times_of_what_is_there(path):
    """Times of the ticks in a file that may be cut off."""
    found = []
    with path.open("rb") as file, suppress(McapError):  # truncated here
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if channel.topic == "/ticks":
                found.append(json.loads(message.data)["time_s"])
    return found
