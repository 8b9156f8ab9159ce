"""The table [faces] of a wiring, options of a command line, and faces found by name."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from umo.clients.faces import face_registry
from umo.clients.faces.face import Face
from umo.clients.faces.face_settings import FaceSettings, faces_of, faces_settings, options_from
from umo.errors import OptionError
from umo.wiring import source

LAMP = f"{__name__}:Lamp"


class Lamp(Face):
    """A face with options."""

    def __init__(self, port: int = 1, place: Path = Path("here"), word: str = "") -> None:
        if port < 0:
            raise OptionError(f"port {port} is below 0")
        self.port, self.place, self.word = port, place, word

    async def begin(self, machine: Any, commands: Any) -> None: ...

    async def frames(self, changes: Any) -> None: ...

    async def end(self, why: str) -> None: ...


class Broken(Lamp):
    def __init__(self) -> None:
        raise RuntimeError("no such lamp")


def test_a_table_has_settings_and_a_table_for_each_face() -> None:
    found = faces_settings({"rate": 5, "commands": True, "dead_bands": {"z.*": 2}, "lamp": {"port": 3}})
    assert found == FaceSettings(5, True, {"z.*": 2}, {"lamp": {"port": 3}})
    assert faces_settings({}) == FaceSettings()


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"rate": 0}, "wiring: faces.rate: must be a number from 0.1 to 100, not 0"),
        ({"rate": "fast"}, "faces.rate: must be a number from 0.1 to 100, not 'fast'"),
        ({"rate": float("nan")}, "faces.rate: must be a number from 0.1 to 100, not nan"),
        ({"commands": "yes"}, "faces.commands: must be true or false"),
        ({"dead_bands": {"z": -1}}, "faces.dead_bands.z: must be a number from 0 on, not -1"),
        ({"dead_bands": {"z": float("nan")}}, "faces.dead_bands.z: must be a number from 0 on, not nan"),
        ({"dead_bands": 3}, "faces.dead_bands: must be a table, not 3"),
        ({"rat": 5}, "faces.rat: unknown key (did you mean 'rate'?); known: rate, commands, dead_bands"),
    ],
)
def test_a_wrong_table_is_refused(table: dict[str, Any], words: str) -> None:
    with pytest.raises(OptionError, match=re.escape(words)):
        faces_settings(table)


def test_a_wiring_may_have_the_table(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text("[faces]\nrate = 5\n[faces.lamp]\nport = 3\n")
    found = source.read(file)
    assert (found.mistakes, found.faces) == ([], {"rate": 5, "lamp": {"port": 3}})


def test_options_of_a_command_line_are_values_of_toml_or_texts() -> None:
    texts = ["lamp.port=3", "lamp.word=red light", f"{LAMP}.port = 4", 'lamp.place="there"']
    assert options_from(texts) == {"lamp": {"port": 3, "word": "red light", "place": "there"}, LAMP: {"port": 4}}


@pytest.mark.parametrize("text", ["port=3", "lamp.port", "=3", ".port=3", "lamp.=3"])
def test_what_is_no_option_is_refused(text: str) -> None:
    with pytest.raises(OptionError, match="is not an option of a face"):
        options_from([text])


def test_a_face_is_made_with_the_options_of_the_table_and_those_of_the_command_line() -> None:
    settings = FaceSettings(options={LAMP: {"port": 3, "word": "red"}})
    ((name, face),) = faces_of(settings, [], {LAMP: {"port": 4}})
    assert isinstance(face, Lamp)
    assert (name, face.port, face.word) == (LAMP, 4, "red")


@pytest.mark.parametrize(
    ("names", "changes", "words"),
    [
        ([], {}, "name a face"),
        ([LAMP], {LAMP: {"porte": 3}}, "porte: unknown key"),
        ([LAMP], {LAMP: {"port": "x"}}, "port: must be a whole number"),
        ([LAMP], {LAMP: {"port": -3}}, "port -3 is below 0"),
        ([LAMP], {"lamb": {"port": 3}}, "an option was given for lamb, which is not served"),
        ([f"{__name__}:Broken"], {}, "cannot be created: RuntimeError: no such lamp"),
        ([f"{__name__}:Nothing"], {}, "cannot be imported"),
        ([f"{__name__}:source"], {}, "is not a umo face"),
        (["no_such_module:Face"], {}, "cannot be imported"),
    ],
)
def test_what_is_wrong_with_a_face_is_told(names: list[str], changes: dict[str, Any], words: str) -> None:
    with pytest.raises(OptionError, match=words):
        faces_of(FaceSettings(), names, changes)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("porte = 3", f"rig.toml:4: faces.{LAMP}.porte: unknown key (did you mean 'port'?)"),
        ("port = 'x'", f"rig.toml:4: faces.{LAMP}.port: must be a whole number"),
        ("port = -3", f"rig.toml:3: faces.{LAMP}: port -3 is below 0"),
    ],
)
def test_a_mistake_in_the_options_of_a_face_has_its_line(tmp_path: Path, line: str, told: str) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(f'[faces]\nrate = 5\n[faces."{LAMP}"]\n{line}\n')
    settings = faces_settings(tomllib.loads(file.read_text())["faces"], str(file))
    with pytest.raises(OptionError) as caught:
        faces_of(settings, [], {})
    assert told in str(caught.value)
    with pytest.raises(OptionError, match=r"^the command line: faces\..*\.prot: unknown key"):
        faces_of(faces_settings({LAMP: {}}, str(file)), [], {LAMP: {"prot": 3}})


def test_a_name_that_is_no_face_has_the_nearest_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(face_registry, "known_faces", lambda: {"prometheus": "umo.clients.faces.prometheus:Prometheus"})
    with pytest.raises(OptionError, match=r"no face 'promteus' \(did you mean 'prometheus'\?\)"):
        face_registry.find_face("promteus")


def test_a_library_that_is_not_installed_is_told_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> Any:
        raise ModuleNotFoundError("No module named 'glow'", name="glow")

    monkeypatch.setattr(face_registry, "known_faces", lambda: {"lamp": "umo.clients.faces.lamp:Lamp"})
    monkeypatch.setattr(face_registry.importlib, "import_module", fail)
    with pytest.raises(OptionError, match=r'the face lamp needs glow: pip install "\.\[lamp\]" in the clone of umo'):
        face_registry.find_face("lamp")


def test_a_relative_path_of_a_wiring_starts_from_its_folder_and_one_of_the_command_line_does_not(
    tmp_path: Path,
) -> None:
    settings = faces_settings({LAMP: {"place": "cell.pem"}}, str(tmp_path / "rig.toml"))
    ((_, face),) = faces_of(settings, [], {})
    ((_, other),) = faces_of(settings, [], {LAMP: {"place": "other.pem"}})
    assert isinstance(face, Lamp) and isinstance(other, Lamp)
    assert (face.place, other.place) == (tmp_path / "cell.pem", Path("other.pem"))
