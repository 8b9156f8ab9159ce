"""Other people's readers find what was recorded, number by number."""

import hashlib
import json
import os
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2
from mcap.reader import make_reader

from helpers import npm
from helpers.recorded import block_at_random, decoded, layout_of
from umo.process.frames import Layout
from umo.recording.block import TakenCommand
from umo.recording.copying import repair
from umo.recording.mcap_reader import McapReader
from umo.recording.protobuf_channels import ProtobufChannels
from umo.recording.recording import Recording
from umo.recording.recording_file import RecordingFile
from umo.recording.tables.dataset import attributes

PARTS = Layout(
    (
        {"path": "z.motor", "unit": "V", "minimum": -10.0, "maximum": 10.0},
        {"path": "z.limit", "one": "OPEN", "zero": "CLOSED"},
        {"path": "zones.0.heat", "unit": "W"},
        {"path": "zones.1.heat", "unit": "W"},
        {"path": "timer", "unit": "ms"},
    ),
    ("sample",),
    layout_of().about,
    (
        {"path": "z.servo.error", "unit": "um"},
        {"path": "z.mode.state", "unit": "", "states": {"3": "idle", "7": "run-1"}},
    ),
    equipment=({"path": "z", "states": ["clear", "fault"]},),
    axes=({"path": "z", "states": ["disabled", "standstill"]},),
    alarms=({"path": "hot", "states": ["normal"]},),
)


def test_the_machine_is_nested_like_its_tree_with_states_as_enums(tmp_path: Path) -> None:
    block = block_at_random(PARTS, 0, 50, 1)
    frames = block.frames
    frames["values"][:, 1] = np.arange(50) % 2
    frames["values"][7, 1] = np.nan
    frames["signals"][:, 1], frames["equipment"], frames["axes"] = 7.0, 1, 1
    file = RecordingFile(tmp_path / "run.mcap", PARTS, ProtobufChannels(PARTS))
    file.add([block])
    file.close()
    with open(tmp_path / "run.mcap", "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [(schema, channel, message) for schema, channel, message in reader.iter_messages(["machine"])]
    assert len(found) == 50 and found[0][1].metadata["z.motor"] == "V, -10 to 10"
    for row, (schema, _, message) in zip(frames, found, strict=True):
        machine = decoded(schema, message.data)
        values = [machine.z.motor, machine.zones._0.heat, machine.zones._1.heat, machine.timer]
        assert np.array_equal(values, row["values"][[0, 2, 3, 4]])
        assert machine.z.servo.error == row["signals"][0] and message.log_time == row["began"] + row["utc"]
    limits = [decoded(schema, message.data).z.limit for schema, _, message in found]
    assert limits[:8] == [0, 1, 0, 1, 0, 1, 0, 127]
    last = str(decoded(found[9][0], found[9][2].data))
    assert "limit: OPEN" in last and "state: run_1" in last and "fault" in last and "standstill" in last
    assert "UNKNOWN" in str(decoded(found[7][0], found[7][2].data))
    file_type = descriptor_pb2.FileDescriptorSet.FromString(found[0][0].data).file[0]
    heated = [each.name for each in file_type.message_type if [field.name for field in each.field] == ["heat"]]
    assert len(heated) == 1  # zones that are alike have one type


def test_other_tools_get_as_many_messages_as_asked_and_the_first_change_of_a_state_in_between(tmp_path: Path) -> None:
    block = block_at_random(PARTS, 0, 1000, 1)
    block.frames["values"][:, 1] = (np.arange(1000) >= 505) & (np.arange(1000) != 507)
    block.frames["signals"][:, 1], block.frames["equipment"], block.frames["axes"] = 7.0, 0, 0
    file = RecordingFile(tmp_path / "run.mcap", PARTS, ProtobufChannels(PARTS, rate=100))
    file.add([block])
    file.close()
    with open(tmp_path / "run.mcap", "rb") as stream:
        told = [message.sequence for _, _, message in make_reader(stream).iter_messages(["machine"])]
    assert told == sorted([*range(0, 1000, 10), 505])


def test_events_commands_and_progress_have_channels(tmp_path: Path) -> None:
    block = block_at_random(PARTS, 0, 5, 1)
    block.frames["progress"], block.frames["done"], block.frames["total"] = b"part", [1, 1, 2, 2, 2], 9
    file = RecordingFile(tmp_path / "run.mcap", PARTS, ProtobufChannels(PARTS))
    file.add([block])
    file.close()
    with open(tmp_path / "run.mcap", "rb") as stream:
        told: dict[str, list[Any]] = {}
        for schema, channel, message in make_reader(stream).iter_messages():
            if schema is not None and channel.topic != "machine":
                told.setdefault(channel.topic, []).append(decoded(schema, message.data))
    assert [each.done for each in told["progress"]] == [1, 2]
    assert told["events"][0].text == "Größe" and told["events"][0].state == "done"
    assert [each.text for each in told["commands"]] == ['{"do": "lease"}', "{}"]


def test_units_of_ten_thousand_numbers_are_there_and_are_not_written_again_each_second(
    tmp_path: Path,
) -> None:
    objects = ({"path": f"zones.{i}.heat", "unit": "W", "minimum": 0.0, "maximum": i + 1.0} for i in range(10_000))
    many = replace(PARTS, objects=tuple(objects))
    file = RecordingFile(tmp_path / "run.mcap", many, ProtobufChannels(many))
    file.add([block_at_random(many, 0, 2, 1)])
    file.add([block_at_random(many, 2, 2, 1)])
    file.close()
    with open(tmp_path / "run.mcap", "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        units = next(record.metadata for record in reader.iter_metadata() if record.name == "units")
        summary = reader.get_summary()
    assert len(units) == 10_001 and units["zones.9999.heat"] == "W, 0 to 10000" and units["z.servo.error"] == "um"
    assert summary is not None
    told = next(channel.metadata for channel in summary.channels.values() if channel.topic == "machine")
    assert told == {"units": "in the metadata record units"}
    content = (tmp_path / "run.mcap").read_bytes()
    assert content.count(b"W, 0 to 10000") == 1 and content.find(b"W, 0 to 10000") < McapReader(file.path).chunks[0]
    with Recording(tmp_path / "run.mcap") as recording:
        assert [attributes(each)["units"] for each in recording.layout.described.objects] == ["W"] * 10_000


# Readers of other projects ------------------------------------------------------------------------------

CORE = Path(__file__).parent / "mcap_core"


def sample(path: Path) -> tuple[Counter[str], str]:
    """A recording of three seconds: the number of messages of each topic, and a hash of those of `machine`."""
    file = RecordingFile(path, PARTS, ProtobufChannels(PARTS))
    for number in range(3):
        file.add([block_at_random(PARTS, 100 * number, 100, number)])
    file.close()
    counts: Counter[str] = Counter()
    digest = hashlib.sha256()
    with open(path, "rb") as stream:
        for _, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            counts[channel.topic] += 1
            if channel.topic == "machine":
                digest.update(message.data)
    assert counts["machine"] == 300
    return counts, digest.hexdigest()


@pytest.mark.full
def test_the_reader_of_foxglove_finds_the_same_messages(tmp_path: Path) -> None:
    counts, digest = sample(tmp_path / "run.mcap")
    modules = npm.modules(CORE)
    command = ["node", str(CORE / "read.cjs"), str(modules), str(tmp_path / "run.mcap")]
    found = json.loads(subprocess.run(command, capture_output=True, check=True, timeout=60).stdout)
    assert found == {"counts": counts, "hash": digest}


@pytest.mark.full
def test_rerun_converts_it_message_by_message(tmp_path: Path) -> None:
    rerun = os.environ.get("UMO_RERUN") or shutil.which("rerun")
    if rerun is None:
        pytest.skip("the test with Rerun needs its command: pip install rerun-sdk, or UMO_RERUN with its path")
    counts, _ = sample(tmp_path / "run.mcap")
    out = tmp_path / "run.rrd"
    subprocess.run([rerun, "mcap", "convert", tmp_path / "run.mcap", "-o", out], check=True, capture_output=True)
    shown = subprocess.run([rerun, "rrd", "print", out], check=True, capture_output=True, text=True).stdout
    rows = re.findall(r"with (\d+) rows .* - /machine - data columns: \[umo\.Machine:message\]", shown)
    assert sum(map(int, rows)) == counts["machine"]


def counted_by_core(path: Path) -> int | None:
    """Messages of `machine` that the reader of Foxglove finds; None: it refuses the file."""
    command = ["node", str(CORE / "read.cjs"), str(npm.modules(CORE)), str(path)]
    done = subprocess.run(command, capture_output=True, timeout=60)
    return None if done.returncode else int(json.loads(done.stdout)["counts"].get("machine", 0))


def counted_by_rerun(path: Path) -> int | None:
    """Messages of `machine` that Rerun converts; None: it refuses the file."""
    rerun, out = os.environ.get("UMO_RERUN") or shutil.which("rerun"), path.with_suffix(".rrd")
    if rerun is None:
        pytest.skip("the test with Rerun needs its command: pip install rerun-sdk, or UMO_RERUN with its path")
    out.unlink(missing_ok=True)
    done = subprocess.run([rerun, "mcap", "convert", path, "-o", out], capture_output=True, text=True)
    if done.returncode or not out.exists():
        return None
    shown = subprocess.run([rerun, "rrd", "print", out], check=True, capture_output=True, text=True).stdout
    rows = re.findall(r"with (\d+) rows .* - /machine - data columns: \[umo\.Machine:message\]", shown)
    return sum(map(int, rows))


@pytest.mark.full
@pytest.mark.parametrize("counted", [counted_by_core, counted_by_rerun])
def test_others_refuse_a_cut_file_or_read_no_more_than_umo_and_as_much_once_it_is_repaired(
    tmp_path: Path, counted: Callable[[Path], int | None]
) -> None:
    sample(tmp_path / "run.mcap")
    content, cut = (tmp_path / "run.mcap").read_bytes(), tmp_path / "cut.mcap"
    first = McapReader(tmp_path / "run.mcap").chunks[0]
    refused = 0
    for at in np.linspace(first + 100, len(content) - 1, 16).astype(int).tolist():
        cut.write_bytes(content[:at])
        with Recording(cut) as recording:
            periods = len(recording.frames())
        found = counted(cut)
        refused += found is None
        assert found is None or found <= periods
        repair(cut)
        if periods:
            assert counted(cut) == periods
    print(f"{refused} of 16 cut files are refused")


def test_a_name_that_is_no_utf_8_costs_no_record(tmp_path: Path) -> None:
    layout, command = layout_of(), TakenCommand(3, 0, b'{"do": "stop", "who": "\\udcff"}')
    file = RecordingFile(tmp_path / "run.mcap", layout, ProtobufChannels(layout))
    file.add([replace(block_at_random(layout, 0, 3, 1), commands=[command])])
    file.close()
    with open(tmp_path / "run.mcap", "rb") as stream:
        ((schema, _, message),) = make_reader(stream).iter_messages(["commands"])
    assert decoded(schema, message.data).who == "?"


@pytest.mark.parametrize(
    "paths",
    [
        ["machine.valve", "machine.motor"],
        ["a_parts", "a", "a.b"],
        ["a", "a_parts", "a.b.c", "a.b"],
        ["a_parts.x", "a", "a.x"],
    ],
)
def test_names_of_parts_may_be_those_that_the_message_needs(tmp_path: Path, paths: list[str]) -> None:
    layout = layout_of(len(paths), 0)
    for entry, path in zip(layout.objects, paths, strict=True):
        entry["path"] = path
    file = RecordingFile(tmp_path / "run.mcap", layout, ProtobufChannels(layout))
    file.add([block := block_at_random(layout, 0, 1, 1)])
    file.close()
    with open(tmp_path / "run.mcap", "rb") as stream:
        ((schema, _, message),) = make_reader(stream).iter_messages(["machine"])
    found = re.findall(r": ([-\d.e]+)", str(decoded(schema, message.data)))
    assert sorted(map(float, found)) == pytest.approx(sorted(block.frames["values"][0]))
