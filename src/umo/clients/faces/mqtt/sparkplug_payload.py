"""The payload of Sparkplug B as protobuf messages, made at run time from a table of its fields.

The numbers of the fields are those of the Sparkplug specification 3.0, section 6.4 (package org.eclipse.tahu.protobuf).
Data sets, templates and metadata are left out: protobuf skips unknown fields.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto as Field

INT32, INT64, DOUBLE, BOOLEAN, STRING, PROPERTY_SET = 3, 4, 10, 11, 12, 20
"""Data types (section 6.4.16)."""
GOOD, BAD, STALE = 192, 0, 500
"""The values of the property Quality (section 6.4.15)."""
PACKAGE = "umo.sparkplug_b"
VALUES = "value"
"""The field of a message that contains the message's value."""
FIELDS: Mapping[str, str] = {
    "Payload": "uint64 timestamp 1, Metric* metrics 2, uint64 seq 3, string uuid 4, bytes body 5",
    "Metric": "string name 1, uint64 alias 2, uint64 timestamp 3, uint32 datatype 4, bool is_historical 5, "
    "bool is_transient 6, bool is_null 7, PropertySet properties 9, ?uint32 int_value 10, ?uint64 long_value 11, "
    "?float float_value 12, ?double double_value 13, ?bool boolean_value 14, ?string string_value 15, "
    "?bytes bytes_value 16",
    "PropertySet": "string* keys 1, PropertyValue* values 2",
    "PropertyValue": "uint32 type 1, bool is_null 2, ?uint32 int_value 3, ?uint64 long_value 4, ?float float_value 5, "
    "?double double_value 6, ?bool boolean_value 7, ?string string_value 8, ?PropertySet propertyset_value 9",
}
"""Messages and their fields: type (`*` if repeated), name and number; `?` marks the alternatives for the message's
value."""


def _classes() -> Mapping[str, Any]:
    file = descriptor_pb2.FileDescriptorProto(name="umo/sparkplug_b.proto", package=PACKAGE, syntax="proto2")
    for name, fields in FIELDS.items():
        message = file.message_type.add(name=name)
        if "?" in fields:
            message.oneof_decl.add(name=VALUES)
        for each in fields.split(", "):
            kind, field, number = each.split()
            label = Field.LABEL_REPEATED if kind.endswith("*") else Field.LABEL_OPTIONAL
            made = message.field.add(name=field, number=int(number), label=label)
            if kind.startswith("?"):
                made.oneof_index = 0
            if (kind := kind.strip("?*")) in FIELDS:
                made.type, made.type_name = Field.TYPE_MESSAGE, f".{PACKAGE}.{kind}"
            else:
                made.type = Field.Type.Value(f"TYPE_{kind.upper()}")
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(file.SerializeToString())
    found = {name: pool.FindMessageTypeByName(f"{PACKAGE}.{name}") for name in FIELDS}
    return {name: message_factory.GetMessageClass(each) for name, each in found.items()}


Payload: Any = _classes()["Payload"]


def put_value(metric: Any, value: float | int | bool | str | None) -> None:
    """Give a metric its value and data type: DOUBLE for a float, INT64 for an int."""
    metric.datatype = _put(metric, value)


def put_property(metric: Any, key: str, value: float | int | bool | str | Mapping[str, str]) -> None:
    """Add a property. A mapping becomes a set of properties; an int becomes an INT32."""
    _add_property(metric.properties, key, value)


def _add_property(found: Any, key: str, value: Any) -> None:
    found.keys.append(key)
    item = found.values.add()
    if isinstance(value, Mapping):
        item.type = PROPERTY_SET
        for name, each in value.items():
            _add_property(item.propertyset_value, name, each)
    elif isinstance(value, int) and not isinstance(value, bool):
        item.type, item.int_value = INT32, value & 0xFFFFFFFF
    else:
        item.type = _put(item, value)


def _put(found: Any, value: float | int | bool | str | None) -> int:
    if isinstance(value, bool):
        found.boolean_value = value
        return BOOLEAN
    if isinstance(value, int):
        found.long_value = value & 0xFFFFFFFFFFFFFFFF
        return INT64
    if isinstance(value, float):
        found.double_value = value
        return DOUBLE
    if value is None:
        found.is_null = True
    else:
        found.string_value = value
    return STRING


def value_of(found: Any) -> Any:
    """Return the value of a metric or property; None if it has no value of a known type."""
    field = found.WhichOneof(VALUES)
    if field is None or found.is_null:
        return None
    value = getattr(found, field)
    kind = found.datatype if hasattr(found, "datatype") else found.type
    if field == "int_value" and kind <= INT32 and value >= 1 << 31:
        return value - (1 << 32)
    if field == "long_value" and kind == INT64 and value >= 1 << 63:
        return value - (1 << 64)
    return value


def properties_of(metric: Any) -> dict[str, Any]:
    return dict(zip(metric.properties.keys, map(value_of, metric.properties.values), strict=False))
