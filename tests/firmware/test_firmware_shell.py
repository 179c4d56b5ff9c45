"""What can be known of the ESP32 shell without its tool chain: syntax, types, settings, the native suite."""

from __future__ import annotations

import configparser
import re
import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent
FIRMWARE = HERE.parent.parent / "esp32_firmware"
CORE = FIRMWARE / "lib/radio_core"
STRICT = ("-std=gnu17", "-Wall", "-Wextra", "-Werror", "-Werror=incompatible-pointer-types")


def gcc(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    command = ["gcc", *(str(argument) for argument in arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("idf_minor", [4, 5])
def test_the_shell_fits_both_forms_of_the_send_callback(idf_minor):
    includes = ("-I", HERE / "idf_stubs", "-I", CORE)
    sources = sorted((FIRMWARE / "src").glob("*.c"))
    assert len(sources) == 4
    result = gcc("-fsyntax-only", *STRICT, f"-DIDF_MINOR={idf_minor}", *includes, *sources)
    assert (result.returncode, result.stderr) == (0, "")


def test_a_callback_of_the_wrong_form_does_not_compile(tmp_path):
    """That is: the check above can fail."""
    source = (FIRMWARE / "src/hal_espnow.c").read_text()
    wrong = tmp_path / "hal_espnow.c"
    wrong.write_text(source.replace("ESP_IDF_VERSION >= ESP_IDF_VERSION_VAL(5, 5, 0)", "0"))
    includes = ("-I", HERE / "idf_stubs", "-I", CORE, "-I", FIRMWARE / "src")
    result = gcc("-fsyntax-only", *STRICT, "-DIDF_MINOR=5", *includes, wrong)
    assert "incompatible-pointer-types" in result.stderr


def test_the_native_suite_passes_with_a_stand_in_for_unity(tmp_path):
    program = tmp_path / "native"
    suite = FIRMWARE / "test/test_radio_core/test_main.c"
    includes = ("-I", HERE / "unity_stub", "-I", CORE)
    built = gcc(*STRICT, *includes, suite, *CORE.glob("*.c"), "-o", program)
    assert built.returncode == 0, built.stderr
    result = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout.count("passed test_")) == (0, 3)


def test_a_channel_that_the_region_forbids_is_neither_stored_nor_keeps_the_radio_from_starting(tmp_path):
    """A stored one would end in a boot loop that only erasing the flash could break."""
    program = tmp_path / "channel"
    includes = ("-I", HERE / "idf_stubs", "-I", CORE, "-I", FIRMWARE / "src")
    built = gcc(
        *STRICT, "-DIDF_MINOR=5", *includes, HERE / "shell_channel.c", *CORE.glob("*.c"), "-o", program
    )
    assert built.returncode == 0, built.stderr
    result = subprocess.run([str(program)], capture_output=True, text=True, check=True)
    told = [line for line in result.stdout.splitlines() if line.startswith(("stored", "started"))]
    assert told == ["stored 1", "stored 1", "started 1"]


def test_platformio_pins_the_platform_and_the_signature_check():
    config = configparser.ConfigParser()
    config.read(FIRMWARE / "platformio.ini")
    radio = config["env:esp32-s3"]
    assert radio["platform"] == "espressif32@6.13.0"
    assert radio["framework"] == "espidf"
    assert "-Werror=incompatible-pointer-types" in radio["build_flags"]
    assert config["env:native"]["platform"] == "native"


def test_every_source_of_the_shell_is_in_its_build():
    listed = re.search(r"SRCS ([\w. ]+)\n", (FIRMWARE / "src/CMakeLists.txt").read_text())
    assert listed is not None
    assert sorted(listed[1].split()) == sorted(path.name for path in (FIRMWARE / "src").glob("*.c"))


def test_nothing_but_the_link_uses_the_usb_port():
    settings = (FIRMWARE / "sdkconfig.defaults").read_text().splitlines()
    assert "CONFIG_ESP_CONSOLE_UART_DEFAULT=y" in settings
    assert "CONFIG_ESP_CONSOLE_SECONDARY_NONE=y" in settings
