"""The table [faces] of a wiring, options of a command line, and faces found by name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from umo.errors import OptionError
from umo.faces import face_registry
from umo.faces.face import Face
from umo.faces.face_settings import FaceSettings, faces_of, options_from, settings_of
from umo.wiring import source

LAMP = "test_face_settings:Lamp"


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
    found = settings_of({"rate": 5, "commands": True, "dead_bands": {"z.*": 2}, "lamp": {"port": 3}})
    assert found == FaceSettings(5, True, {"z.*": 2}, {"lamp": {"port": 3}})
    assert settings_of({}) == FaceSettings()


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"rate": 0}, "the rate 0 is not a number from 0.1 to 100"),
        ({"rate": "fast"}, "the rate 'fast'"),
        ({"rate": float("nan")}, "the rate nan"),
        ({"commands": "yes"}, "neither true nor false"),
        ({"dead_bands": {"z": -1}}, "the dead band -1 of z"),
        ({"dead_bands": {"z": float("nan")}}, "the dead band nan of z"),
        ({"dead_bands": 3}, "dead_bands is a table"),
        ({"rat": 5}, "rat = 5 (did you mean 'rate'?)"),
    ],
)
def test_a_wrong_table_is_refused(table: dict[str, Any], words: str) -> None:
    with pytest.raises(OptionError, match=re.escape(words)):
        settings_of(table)


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
    with pytest.raises(OptionError, match="is no option of a face"):
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
        ([LAMP], {"lamb": {"port": 3}}, "an option of lamb"),
        (["test_face_settings:Broken"], {}, "cannot be made: RuntimeError: no such lamp"),
        (["test_face_settings:Nothing"], {}, "cannot be imported"),
        (["test_face_settings:source"], {}, "is not a umo face"),
        (["no_such_module:Face"], {}, "cannot be imported"),
    ],
)
def test_what_is_wrong_with_a_face_is_told(names: list[str], changes: dict[str, Any], words: str) -> None:
    with pytest.raises(OptionError, match=words):
        faces_of(FaceSettings(), names, changes)


def test_a_name_that_is_no_face_has_the_nearest_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(face_registry, "known_faces", lambda: {"prometheus": "umo.faces.prometheus:Prometheus"})
    with pytest.raises(OptionError, match=r"no face 'promteus' \(did you mean 'prometheus'\?\)"):
        face_registry.find_face("promteus")


def test_a_library_that_is_not_installed_is_told_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> Any:
        raise ModuleNotFoundError("No module named 'glow'", name="glow")

    monkeypatch.setattr(face_registry, "known_faces", lambda: {"lamp": "umo.faces.lamp:Lamp"})
    monkeypatch.setattr(face_registry.importlib, "import_module", fail)
    with pytest.raises(OptionError, match=r'the face lamp needs glow: pip install "umo\[lamp\]"'):
        face_registry.find_face("lamp")


def test_a_relative_path_of_a_wiring_starts_from_its_folder_and_one_of_the_command_line_does_not(
    tmp_path: Path,
) -> None:
    settings = settings_of({LAMP: {"place": "cell.pem"}}, str(tmp_path / "rig.toml"))
    ((_, face),) = faces_of(settings, [], {})
    ((_, other),) = faces_of(settings, [], {LAMP: {"place": "other.pem"}})
    assert isinstance(face, Lamp) and isinstance(other, Lamp)
    assert (face.place, other.place) == (tmp_path / "cell.pem", Path("other.pem"))
