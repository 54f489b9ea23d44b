"""Decodes, by Google's protobuf and the schema of each channel, what `foxglove_client.mjs` received. Standard input to output: JSON."""

import base64
import json
import sys

from google.protobuf import descriptor_pool, json_format, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet

report = json.load(sys.stdin)
for topic, channel in report["channels"].items():
    assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf"), topic
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(base64.b64decode(channel.pop("schema"))).file:
        pool.Add(file)
    message = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))()
    if data := channel.pop("data", None):
        data = base64.b64decode(data)
        message.ParseFromString(data)
        # Every byte is of a field that the schema has.
        message.DiscardUnknownFields()
        channel["is_of_schema"] = message.ByteSize() == len(data)
        channel["message"] = json_format.MessageToDict(message, preserving_proto_field_name=True)
json.dump(report, sys.stdout)
