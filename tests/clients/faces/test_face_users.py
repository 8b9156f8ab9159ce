"""The users of faces: passwords, certificates, the file that has them."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest

from umo.clients.faces import face_users
from umo.clients.faces.face_users import by_certificate, by_password, hashed

ANN = hashed("hunter2")


def written(folder: Path, text: str, mode: int = 0o600) -> Path:
    file = folder / "face_users.toml"
    file.write_text(text)
    file.chmod(mode)
    return file


def test_only_the_right_password_of_a_known_user_counts(tmp_path: Path) -> None:
    file = written(tmp_path, f'[passwords]\nann = "{ANN}"\n')
    assert by_password("ann", "hunter2", file)
    for name, password in (("ann", "hunter3"), ("ann", ""), ("Ann", "hunter2"), ("bob", "hunter2"), ("", "")):
        assert not by_password(name, password, file)
    assert not by_password("ann", "hunter2" + "x" * 2000, file)


@pytest.mark.parametrize(
    "kept",
    [
        '"hunter2"', '""', "5", "[]", '"scrypt:16384:8:1:!:!"', '"scrypt:3:8:1:AAAA:AAAA"',
        '"scrypt:1073741824:8:1:AAAA:AAAA"', '"md5:16384:8:1:AAAA:AAAA"', '"scrypt:16384:8:1:AAAA:"',
    ],
)  # fmt: skip
def test_what_is_no_hash_lets_nobody_in(tmp_path: Path, kept: str) -> None:
    file = written(tmp_path, f"[passwords]\nann = {kept}\n")
    assert not by_password("ann", "hunter2", file)
    assert not by_password("ann", "", file)


def test_a_certificate_is_known_by_its_fingerprint_as_openssl_prints_it(tmp_path: Path) -> None:
    digest = hashlib.sha256(b"der").hexdigest()
    colons = ":".join(digest[n : n + 2] for n in range(0, 64, 2)).upper()
    for text in (digest, colons, f"sha256 Fingerprint={colons}"):
        file = written(tmp_path, f'[certificates]\nbob = "{text}"\n')
        assert by_certificate(b"der", file) == "bob"
        assert by_certificate(b"other", file) is None


@pytest.mark.parametrize("text", ["[passwords", "passwords = 5", "\x00", "[passwords]\nann = {}", "[" * 5000])
def test_a_file_that_cannot_be_read_lets_nobody_in(tmp_path: Path, text: str) -> None:
    file = written(tmp_path, text)
    assert not by_password("ann", "hunter2", file)
    assert by_certificate(b"der", file) is None


def test_a_file_that_others_may_write_lets_nobody_in(tmp_path: Path) -> None:
    text = f'[passwords]\nann = "{ANN}"\n'
    assert not by_password("ann", "hunter2", written(tmp_path, text, 0o666))
    assert by_password("ann", "hunter2", written(tmp_path, text))


def test_without_a_file_nobody_is_let_in(tmp_path: Path) -> None:
    assert not by_password("ann", "hunter2", tmp_path / "none.toml")


def test_the_line_for_the_file_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("getpass.getpass", lambda *_: 'a "quoted" \\ word')
    monkeypatch.setattr("sys.argv", ["face_users", 'an"n'])
    assert face_users.main() == 0
    file = written(tmp_path, "[passwords]\n" + capsys.readouterr().out)
    assert by_password('an"n', 'a "quoted" \\ word', file)
    monkeypatch.setattr("sys.argv", ["face_users"])
    assert face_users.main() == 2


@pytest.mark.parametrize("typed", [["", ""], ["hunter2", "hunter3"]])
def test_an_empty_password_or_one_that_is_typed_wrong_makes_no_line(
    typed: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("getpass.getpass", lambda *_: typed.pop(0))
    monkeypatch.setattr("sys.argv", ["face_users", "ann"])
    assert face_users.main() == 2
    told = capsys.readouterr()
    assert told.out == "" and "password" in told.err


@pytest.mark.parametrize(("given", "status"), [(["--help"], 0), (["-h"], 0), (["--user"], 2), (["ann", "--help"], 2)])
def test_help_asks_for_no_password(
    given: list[str], status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("getpass.getpass", lambda *_: pytest.fail("it asks for a password"))
    monkeypatch.setattr("sys.argv", ["face_users", *given])
    assert face_users.main() == status
    told = capsys.readouterr()
    assert "python -m umo.clients.faces.face_users NAME" in (told.out if status == 0 else told.err)


def test_every_login_computes_one_scrypt_with_the_parameters_of_a_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed: list[tuple[int, int, int]] = []
    real = hashlib.scrypt

    def counted(*given: Any, **more: Any) -> bytes:
        computed.append((more["n"], more["r"], more["p"]))
        return real(*given, **more)

    ann, bob = hashed("a"), "scrypt:1024:4:1:MTIzNDU2Nzg5MDEyMzQ1Ng==:MTIzNDU2Nzg5MDEyMzQ1Ng=="
    several = written(tmp_path, f'[passwords]\nann = "{ann}"\nbob = "{bob}"\ncid = "scrypt:3:x"\ndot = 7\n')
    monkeypatch.setattr(hashlib, "scrypt", counted)
    for name in ("ann", "bob", "cid", "dot", "", "\udc80", *(f"eve {number}" for number in range(10))):
        before = len(computed)
        assert not by_password(name, "wrong", several)
        assert not by_password(name, "wrong", several)  # it does not tell by another time the second time
        (first, second) = computed[before:]
        assert first == second
        assert first in {(1 << 14, 8, 1), (1024, 4, 1)}
    assert not by_password("eve", "wrong", tmp_path / "none.toml")
    assert computed[-1] == (1 << 14, 8, 1)
