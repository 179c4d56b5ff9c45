"""The file of a fleet key: made once, read strictly, never shown."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
from commands_run import refused, run

from hippomat_core.errors import HippomatError
from hippomat_host.key_file import KEY_BYTES, FleetKey, fingerprint, make_key, read_key

DIGITS = "00112233445566778899aabbccddeeff"


def written(path: Path, text: str | bytes) -> str:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    path.chmod(0o600)
    return str(path)


def test_a_made_key_is_fresh_private_and_reads_back(tmp_path: Path) -> None:
    os.umask(0o000)
    keys = [make_key(str(tmp_path / name)) for name in "ab"]
    os.umask(0o022)
    assert keys[0].key != keys[1].key
    for name, key in zip("ab", keys, strict=True):
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o600
        read = read_key(str(tmp_path / name))
        assert (read.key, read.warning) == (key.key, "")
        assert len(read.key) == KEY_BYTES


def test_a_key_is_never_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path / "key", "dear")
    assert "exists: a key is never overwritten" in refused(capsys, "make-key", path)
    assert (tmp_path / "key").read_text() == "dear"
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "nowhere")
    assert "exists" in refused(capsys, "make-key", link)
    assert "cannot be written: No such file" in refused(capsys, "make-key", tmp_path / "no" / "key")


def test_making_a_key_says_the_fingerprint_and_not_the_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ended = run(capsys, "make-key", tmp_path / "key")
    digits = (tmp_path / "key").read_text().strip()
    assert ended.code == 0
    assert fingerprint(bytes.fromhex(digits)) in ended.out
    assert digits not in ended.out


def test_a_fingerprint_tells_keys_apart_and_is_two_bytes_short() -> None:
    prints = {fingerprint(os.urandom(16)) for _ in range(100)}
    assert len(prints) > 95
    assert {len(one) for one in prints} == {4}


@pytest.mark.parametrize("text", [DIGITS, DIGITS.upper() + "\r\n", f"\n  {DIGITS}\n\n"])
def test_a_key_may_be_written_in_either_case_with_space_around(tmp_path: Path, text: str) -> None:
    assert read_key(written(tmp_path / "key", text)).key == bytes.fromhex(DIGITS)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "holds 0 characters, a key is 32 hex digits"),
        (DIGITS[:-1], "holds 31 characters"),
        (DIGITS + "0", "holds 33 characters"),
        (DIGITS[:-1] + "g", "something else than hex digits"),
        (DIGITS[:-1] + "\u0663", "something else than hex digits|holds 33 characters"),
        (bytes(16), "holds 16 characters"),
        (b"\xff" * 32, "something else than hex digits"),
        (b"0" * 100_000, "more than 4096 characters"),
        ("0" * 32, "typed, not drawn"),
        ("12" * 16, "typed, not drawn"),
    ],
)
def test_what_is_no_key_is_refused_without_being_quoted(tmp_path: Path, text: str | bytes, part: str) -> None:
    path = written(tmp_path / "key", text)
    with pytest.raises(HippomatError, match=part) as caught:
        read_key(path)
    assert str(caught.value).endswith("`hippomat-host make-key FILE` makes one")
    if text:
        assert str(text)[2:20] not in str(caught.value)


@pytest.mark.parametrize("name", ["absent", "."])
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(HippomatError, match=r"--key-file .* cannot be read"):
        read_key(str(tmp_path / name))


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(HippomatError, match="cannot be read: not a regular file"):
        read_key(str(tmp_path / "pipe"))


def test_a_key_that_could_not_be_written_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(HippomatError, match="cannot be written: No space left"):
        make_key(str(tmp_path / "key"))
    assert not (tmp_path / "key").exists()


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o602, 0o777])
def test_a_key_that_others_can_reach_is_warned_about(tmp_path: Path, mode: int) -> None:
    path = written(tmp_path / "key", DIGITS)
    os.chmod(path, mode)
    assert f"chmod 600 {path}" in read_key(path).warning


def test_a_key_is_not_in_its_repr() -> None:
    key = bytes.fromhex(DIGITS)
    assert repr(key) not in repr(FleetKey(key))
    assert DIGITS not in repr(FleetKey(key))
