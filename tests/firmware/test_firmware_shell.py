"""What can be known of the ESP32 shell without a chip: syntax, types, settings, the native suite.

What it does is in test_shell_on_chip.py and test_shell_traffic.py; against a real ESP-IDF: `make idf-check`.
"""

from __future__ import annotations

import configparser
import os
import re
import shutil
import subprocess
import sys

import pytest
from chip import CORE, FIRMWARE, INCLUDES, SHELL, STRICT, compile_c

PROJECT = FIRMWARE.parent
FLASH_BYTES = 4 << 20
SECTOR_BYTES = 0x1000


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("idf_minor", [4, 5])
@pytest.mark.parametrize(
    "variant", ["", "-DHIPPOMAT_HOST_PORT=hal_uart", "-DHIPPOMAT_LED_PIN=-1", "-DHIPPOMAT_LED_RGB=0"]
)
def test_every_variant_of_the_shell_compiles_with_both_forms_of_the_send_callback(
    compiler, idf_minor, variant
):
    flags = ("-fsyntax-only", *STRICT, f"-DIDF_MINOR={idf_minor}", *filter(None, [variant]))
    result = compile_c(compiler, *flags, *INCLUDES, *sorted(SHELL.glob("*.c")))
    assert (result.returncode, result.stderr) == (0, "")


def test_a_callback_of_the_wrong_form_does_not_compile(tmp_path):
    """That is: the check above can fail."""
    source = (SHELL / "hal_espnow.c").read_text()
    wrong = tmp_path / "hal_espnow.c"
    wrong.write_text(source.replace("ESP_IDF_VERSION >= ESP_IDF_VERSION_VAL(5, 5, 0)", "0"))
    result = compile_c("gcc", "-fsyntax-only", *STRICT, "-DIDF_MINOR=5", *INCLUDES, wrong)
    assert "incompatible-pointer-types" in result.stderr


def test_the_shell_calls_nothing_that_takes_memory_of_its_own(tmp_path):
    """What it starts once (drivers, a timer) takes some; queue and task are given theirs."""
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("nm is not installed")
    sources = [*SHELL.glob("*.c"), *CORE.glob("*.c")]
    for number, source in enumerate(sources):
        built = compile_c("gcc", "-c", "-DIDF_MINOR=5", *INCLUDES, source, "-o", tmp_path / f"{number}.o")
        assert built.returncode == 0, built.stderr
    listed = subprocess.run(
        [nm, "-u", *tmp_path.glob("*.o")], capture_output=True, text=True, check=True
    ).stdout
    needed = {line.split()[-1] for line in listed.splitlines() if " U " in line}
    assert not needed & {"malloc", "calloc", "realloc", "free", "xQueueCreate", "xTaskCreatePinnedToCore"}
    assert {"xQueueCreateStatic", "xTaskCreateStaticPinnedToCore"} <= needed


def test_the_native_suite_passes_with_a_stand_in_for_unity():
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    result = subprocess.run(
        ["make", "firmware-native"], cwd=PROJECT, capture_output=True, text=True, check=False
    )
    suite = (FIRMWARE / "test/test_radio_core/test_main.c").read_text()
    assert result.returncode == 0, result.stderr
    assert result.stdout.count("passed test_") == suite.count("RUN_TEST(") > 5


# ---- settings ------------------------------------------------------------------------------------


def platformio() -> configparser.ConfigParser:
    config = configparser.ConfigParser(interpolation=None)
    config.read(FIRMWARE / "platformio.ini")
    return config


def settings(*files: str) -> dict[str, str]:
    """As ESP-IDF reads them: a later file decides."""
    lines = (line for file in files for line in (FIRMWARE / file).read_text().splitlines())
    return dict(line.split("=", 1) for line in lines if line.startswith("CONFIG_"))


def test_platformio_pins_the_platform_and_the_signature_check():
    config = platformio()
    assert config["radio"]["platform"] == "espressif32@6.13.0"
    assert config["radio"]["framework"] == "espidf"
    assert "-Werror=incompatible-pointer-types" in config["radio"]["build_flags"]
    assert config["env:esp32-s3"]["extends"] == config["env:s3-uart"]["extends"] == "radio"
    assert config["env:native"]["platform"] == "native"


def test_every_source_of_the_shell_is_in_its_build():
    listed = re.search(r"SRCS ([\w. \n]+)REQUIRES", (SHELL / "CMakeLists.txt").read_text())
    assert listed is not None
    assert sorted(listed[1].split()) == sorted(path.name for path in SHELL.glob("*.c"))


def test_nothing_but_the_link_uses_the_port_of_the_data():
    usb = settings("sdkconfig.defaults")
    assert usb["CONFIG_ESP_CONSOLE_UART_DEFAULT"] == usb["CONFIG_ESP_CONSOLE_SECONDARY_NONE"] == "y"
    board = platformio()["env:s3-uart"]
    assert "-DHIPPOMAT_HOST_PORT=hal_uart" in board["build_flags"]
    files = re.search(r'SDKCONFIG_DEFAULTS="([^"]+)"', board["board_build.cmake_extra_args"])
    assert files is not None
    uart = settings(*files[1].split(";"))
    assert uart["CONFIG_ESP_CONSOLE_UART_DEFAULT"] == "n"
    assert uart["CONFIG_ESP_CONSOLE_NONE"] == uart["CONFIG_ESP_CONSOLE_SECONDARY_NONE"] == "y"
    assert uart["CONFIG_BOOTLOADER_LOG_LEVEL_NONE"] == "y"


def test_the_partitions_fill_4_mb_without_overlap_and_hold_two_firmwares_and_our_own_nvs():
    rows = [
        line.split(",") for line in (FIRMWARE / "partitions.csv").read_text().splitlines() if line[:1] != "#"
    ]
    places = [(row[0].strip(), row[2].strip(), int(row[3], 0), int(row[4], 0)) for row in rows]
    end = 0x9000  # behind boot loader and table
    for _, subtype, offset, size in places:
        assert (offset, size % SECTOR_BYTES) == (end, 0)
        assert not subtype.startswith("ota_") or offset % 0x10000 == 0
        end = offset + size
    assert end <= FLASH_BYTES
    assert [size for _, subtype, _, size in places if subtype.startswith("ota_")] == [0x1E0000] * 2
    assert ("hippomat", "nvs") in {(name, subtype) for name, subtype, _, _ in places}
    assert settings("sdkconfig.defaults")["CONFIG_ESPTOOLPY_FLASHSIZE_4MB"] == "y"


def test_the_firmware_names_its_version_and_commit():
    version = re.search(r'^version = "(.+)"$', (PROJECT / "pyproject.toml").read_text(), re.MULTILINE)
    assert version is not None
    assert f'.firmware = "hippomat {version[1]}"' in (SHELL / "main.c").read_text()
    flag = subprocess.run(
        [sys.executable, "git_hash.py"], cwd=FIRMWARE, capture_output=True, text=True, check=True
    ).stdout
    assert re.fullmatch(r"-DHIPPOMAT_GIT_HASH=([0-9a-f]{8}|unknown)\n", flag)


def test_the_check_against_esp_idf_says_what_is_missing(tmp_path):
    command = [sys.executable, FIRMWARE / "tools/idf_check.py"]
    environment = os.environ | {"IDF_PATH": str(tmp_path)}
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "holds no ESP-IDF: set it to a checkout of v5.5.3" in result.stderr
