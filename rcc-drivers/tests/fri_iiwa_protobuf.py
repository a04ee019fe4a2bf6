"""Google's Protocol Buffers as judge of the FRI messages: the schema below was written apart from the one in Rust.

Commands on stdin, a line each: `read M HEX` parses message M (monitoring, command), refuses unknown fields, and prints
the bytes as Google writes them; `make M SEED` prints the bytes of a message with random fields.
"""

import random
import struct
import sys
import zlib

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

SCALARS = {"i32": 5, "u32": 13, "u64": 4, "double": 1, "string": 9, "enum": 5}
# message: field number, name, type; `*` = list, `+` = packed list, with the number of elements of random messages
SCHEMA = {
    "Header": [(1, "id", "u32 required"), (2, "seq", "u32 required"), (3, "refl", "u32 required")],
    "Joints": [(1, "value", "double * 7")],
    "Vector": [(1, "element", "double + 6")],
    "Stamp": [(1, "sec", "u32 required"), (2, "nsec", "u32 required")],
    "Frame": [(1, "name", "string required"), (2, "element", "double + 7"), (3, "time", "Stamp")],
    "Redundancy": [(1, "strategy", "enum"), (2, "value", "double")],
    "Io": [(1, "name", "string required"), (2, "type", "enum required"), (3, "direction", "enum required"),
           (4, "digital", "u64"), (5, "analog", "double")],
    "Crc": [(1, "crc", "i32")],
    "End": [(1, "length", "i32"), (2, "crc", "Crc")],
    "Robot": [(1, "joints", "i32"), (2, "safety", "enum"), (5, "drives", "enum * 7"), (6, "mode", "enum"),
              (7, "control", "enum")],
    "Connection": [(1, "state", "enum required"), (2, "quality", "enum required"), (3, "period", "u32"),
                   (4, "multiplier", "u32")],
    "MonitorData": [(1, "q", "Joints"), (2, "tau", "Joints"), (3, "qc", "Joints"), (4, "tauc", "Joints"),
                    (5, "taue", "Joints"), (6, "force", "Vector"), (8, "io", "Io * 3"), (9, "pose", "Frame"),
                    (10, "red", "Redundancy"), (15, "time", "Stamp")],
    "Ipo": [(1, "q", "Joints"), (2, "pose", "Frame"), (3, "red", "Redundancy"), (10, "mode", "enum"),
            (11, "overlay", "enum"), (12, "tracking", "double")],
    "CommandData": [(1, "q", "Joints"), (2, "wrench", "Vector"), (3, "tau", "Joints"), (4, "frames", "Frame * 2"),
                    (5, "io", "Io * 3"), (6, "pose", "Frame"), (7, "red", "Redundancy")],
    "Monitoring": [(1, "header", "Header required"), (2, "robot", "Robot"), (3, "data", "MonitorData"),
                   (4, "connection", "Connection required"), (5, "ipo", "Ipo"), (6, "frames", "Frame * 2"),
                   (15, "end", "End")],
    "Command": [(1, "header", "Header required"), (2, "data", "CommandData"), (15, "end", "End")],
}
IDENTITY = {"Monitoring": 0x00245142, "Command": 0x00034001}


def classes():
    file = descriptor_pb2.FileDescriptorProto(name="fri.proto", package="fri", syntax="proto2")
    for message, fields in SCHEMA.items():
        into = file.message_type.add(name=message)
        for number, name, words in fields:
            kind, *rest = words.split()
            field = into.field.add(number=number, name=name, label=1)
            if "required" in rest:
                field.label = 2
            if "*" in rest or "+" in rest:
                field.label = 3
            if "+" in rest:
                field.options.packed = True
            if kind in SCALARS:
                field.type = SCALARS[kind]
            else:
                field.type, field.type_name = 11, f".fri.{kind}"
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"fri.{name}")) for name in SCHEMA}


CLASSES = classes()
RANDOM = {
    "i32": lambda: random.choice([0, 1, -1, random.randrange(-(2**31), 2**31)]),
    "enum": lambda: random.randrange(5),
    "u32": lambda: random.choice([0, random.randrange(2**32)]),
    "u64": lambda: random.choice([0, 1, random.randrange(2**64)]),
    "double": lambda: random.choice([0.0, -0.0, 1.5, random.gauss(0, 1000)]),
    "string": lambda: random.choice(["", "FRI.Out_Bool", "ä" * random.randrange(31)]),
}


def fill(message, kind):
    for _, name, words in SCHEMA[kind]:
        of, *rest = words.split()
        many = rest[0] in ("*", "+") if rest else False
        if "required" not in rest and random.random() < 0.4:
            continue
        count = int(rest[1]) if many else 1
        for _ in range(count):
            if of in SCALARS and many:
                getattr(message, name).append(RANDOM[of]())
            elif of in SCALARS:
                setattr(message, name, RANDOM[of]())
            else:
                part = getattr(message, name).add() if many else getattr(message, name)
                part.SetInParent() if not many else None
                fill(part, of)
    return message


def lists_are_full(message):
    """Lists with a fixed count are all there once their message is."""
    for field, value in message.ListFields():
        if field.message_type is None:
            continue
        for part in value if field.is_repeated else [value]:
            name = field.message_type.name
            count = {"Joints": 7, "Vector": 6}.get(name)
            if count:
                numbers = part.value if name == "Joints" else part.element
                while len(numbers) < count:
                    numbers.append(random.random())
            lists_are_full(part)


def answer(order, kind, text):
    message = CLASSES[kind]()
    if order == "make":
        random.seed(text)
        fill(message, kind)
        message.header.id = IDENTITY[kind]
        lists_are_full(message)
    else:
        message.ParseFromString(bytes.fromhex(text))
        kept = CLASSES[kind]()
        kept.CopyFrom(message)
        kept.DiscardUnknownFields()
        if kept.ByteSize() != message.ByteSize():
            return "unknown fields"
    body = message.SerializeToString()
    if order == "frame":  # 2.7: length, message, CRC-32 of zlib over the message alone
        body = struct.pack("<I", len(body)) + body + struct.pack("<I", zlib.crc32(body))
    return body.hex()


print("ready", flush=True)
for line in sys.stdin:
    print(answer(*line.split()), flush=True)
