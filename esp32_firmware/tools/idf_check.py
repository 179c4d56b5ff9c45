"""Compiles the shell and the radio core against a real ESP-IDF's headers: `IDF_PATH=... make idf-check`.

Both boards of platformio.ini, each with the settings that ESP-IDF's own kconfgen makes of sdkconfig.defaults;
says if a setting there did not take effect. Translates to assembly, so that the optimizer's warnings count.
Links nothing and proves nothing about behaviour.

IDF_CC       the compiler, with its options; else the first of COMPILERS that is installed
IDF_INCLUDE  more directories of headers, after ESP-IDF's, joined by ":": newlib's where the compiler is not
             Espressif's, mbedTLS's where the checkout of ESP-IDF has no submodules
"""

from __future__ import annotations

import configparser
import importlib.util
import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

FIRMWARE = Path(__file__).parent.parent
CORE = FIRMWARE / "lib/radio_core"
OUT = FIRMWARE.parent / "build/idf-check"
TARGET = "esp32s3"
COMPILERS = (f"xtensa-{TARGET}-elf-gcc -mlongcalls", "xtensa-lx106-elf-gcc", "gcc -m32 -D__XTENSA__")
STRICT = ["-std=gnu17", "-O2", "-Wall", "-Wextra", "-Werror", "-Werror=incompatible-pointer-types"]
# As ESP-IDF's own build defines them.
DEFINES = ("-DESP_PLATFORM", "-D_GNU_SOURCE", '-DMBEDTLS_CONFIG_FILE="mbedtls/esp_config.h"')
VARIANTS = (("-DHIPPOMAT_LED_RGB=0",), ("-DHIPPOMAT_LED_PIN=-1",))
INCLUDES = """
    freertos/config/include freertos/config/include/freertos freertos/config/xtensa/include
    freertos/FreeRTOS-Kernel/include freertos/FreeRTOS-Kernel/portable/xtensa/include
    freertos/FreeRTOS-Kernel/portable/xtensa/include/freertos freertos/esp_additions/include xtensa/include
    xtensa/{target}/include soc/include soc/{target} soc/{target}/include soc/{target}/register hal/include
    hal/{target}/include hal/platform_port/include esp_rom/include esp_rom/{target} esp_rom/{target}/include
    esp_rom/{target}/include/{target} esp_common/include esp_hw_support/include esp_hw_support/include/soc
    esp_system/include esp_timer/include esp_event/include esp_netif/include esp_wifi/include
    esp_wifi/include/local esp_phy/include esp_driver_gpio/include esp_driver_rmt/include
    esp_driver_uart/include esp_driver_usb_serial_jtag/include heap/include log/include
    newlib/platform_include nvs_flash/include esp_partition/include mbedtls/port/include
    mbedtls/mbedtls/include
"""


class Missing(Exception):
    """Something that the check needs is not here; says which and what to do."""


def idf_path() -> Path:
    given = os.environ.get("IDF_PATH", "")
    path = Path(given).resolve()
    if not given or not (path / "Kconfig").is_file():
        raise Missing(f"IDF_PATH = {given!r} holds no ESP-IDF: set it to a checkout of v5.5.3")
    return path


def compiler() -> list[str]:
    for command in filter(None, (os.environ.get("IDF_CC"), *COMPILERS)):
        if shutil.which(shlex.split(command)[0]):
            return shlex.split(command)
    raise Missing("no compiler: run ESP-IDF's export.sh, or install gcc-xtensa-lx106")


def header_directories(idf: Path) -> list[Path]:
    """Those that exist in this version of ESP-IDF, then IDF_INCLUDE's."""
    ours = (idf / "components" / name.format(target=TARGET) for name in INCLUDES.split())
    more = (Path(name) for name in os.environ.get("IDF_INCLUDE", "").split(":") if name)
    found = [path for path in (*ours, *more) if path.is_dir()]
    if not any((path / "mbedtls/ccm.h").is_file() for path in found):
        raise Missing(
            f"mbedtls/ccm.h: run `git submodule update --init components/mbedtls/mbedtls` in {idf}, "
            "or name the include directory of mbedTLS 3.6 in IDF_INCLUDE"
        )
    return found


def boards() -> dict[str, tuple[list[Path], list[str]]]:
    """Per environment of platformio.ini: the files of settings and the -D flags."""
    config = configparser.ConfigParser(
        interpolation=configparser.ExtendedInterpolation(), strict=True, default_section="env"
    )
    config.read_string((FIRMWARE / "platformio.ini").read_text().replace("${radio.", "${radio:"))
    found = {}
    for name in ("esp32-s3", "s3-uart"):
        section = {**config["radio"], **config[f"env:{name}"]}
        arguments = shlex.split(section.get("board_build.cmake_extra_args", ""))
        defaults = [a.partition("=")[2] for a in arguments if a.startswith("-DSDKCONFIG_DEFAULTS=")]
        files = (defaults or ["sdkconfig.defaults"])[0].split(";")
        flags = [flag for flag in section["build_flags"].split() if flag.startswith("-D")]
        found[name] = ([FIRMWARE / file for file in files], flags)
    return found


def make_settings(idf: Path, files: list[Path], out: Path) -> None:
    """sdkconfig.h and sdkconfig in `out`, as ESP-IDF's build makes them."""
    if importlib.util.find_spec("kconfgen") is None:
        raise Missing("kconfgen: pip install 'esp-idf-kconfig<3' (the Python of an installed ESP-IDF has it)")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    for kind in ("Kconfig", "Kconfig.projbuild"):
        lines = (f'source "{path}"\n' for path in sorted(idf.glob(f"components/*/{kind}")))
        (out / kind).write_text("".join(lines))
    environment = {
        "IDF_PATH": str(idf),
        "IDF_TARGET": TARGET,
        "IDF_TOOLCHAIN": "gcc",
        "COMPONENT_KCONFIGS_SOURCE_FILE": str(out / "Kconfig"),
        "COMPONENT_KCONFIGS_PROJBUILD_SOURCE_FILE": str(out / "Kconfig.projbuild"),
    } | dict.fromkeys(("IDF_VERSION", "IDF_INIT_VERSION", "IDF_ENV_FPGA", "IDF_MINIMAL_BUILD"), "")
    (out / "environment.json").write_text(json.dumps(environment))
    command: list[str | Path] = [
        sys.executable,
        "-m",
        "kconfgen",
        "--list-separator=semicolon",
        "--kconfig",
        idf / "Kconfig",
    ]
    command += ["--sdkconfig-rename", idf / "sdkconfig.rename", "--config", out / "sdkconfig"]
    command += ["--env-file", out / "environment.json"]
    command += [part for file in files for part in ("--defaults", file)]
    command += ["--output", "header", out / "sdkconfig.h", "--output", "config", out / "sdkconfig"]
    subprocess.run(command, check=True, env=os.environ | environment, stdout=subprocess.DEVNULL)


def without_effect(files: list[Path], made: Path) -> list[str]:
    """Settings of ours that ESP-IDF does not know or did not take."""
    ours: dict[str, str] = {}
    for file in files:
        lines = (line for line in file.read_text().splitlines() if line.startswith("CONFIG_"))
        ours |= dict(line.split("=", 1) for line in lines)
    took = set(made.read_text().splitlines())
    wanted = {
        name: f"# {name} is not set" if value == "n" else f"{name}={value}" for name, value in ours.items()
    }
    return [line for name, line in wanted.items() if line not in took]


def check_partitions(idf: Path) -> int:
    """ESP-IDF's own tool refuses what overlaps, is misaligned or does not fit."""
    tool = idf / "components/partition_table/gen_esp32part.py"
    table = OUT / "partitions.bin"
    OUT.mkdir(parents=True, exist_ok=True)
    command: list[str | Path] = [
        sys.executable,
        tool,
        "--quiet",
        "--flash-size",
        "4MB",
        FIRMWARE / "partitions.csv",
        table,
    ]
    failed = subprocess.run(command, check=False).returncode != 0
    print(f"partitions.csv in 4 MB: {'refused' if failed else 'well'}")
    return int(failed)


def check(board: str, idf: Path, start: list[str], files: list[Path], flags: list[str]) -> int:
    """The number of complaints."""
    out = OUT / board
    make_settings(idf, files, out)
    complaints = without_effect(files, out / "sdkconfig")
    print("".join(f"{board}: without effect: {line}\n" for line in complaints), end="")
    jobs: list[tuple[Path, tuple[str, ...]]] = [
        (path, ()) for path in (*sorted(CORE.glob("*.c")), *sorted((FIRMWARE / "src").glob("*.c")))
    ]
    jobs += [(FIRMWARE / "src/hal_board.c", variant) for variant in VARIANTS]
    failed = 0
    for path, variant in jobs:
        command = [*start, *flags, *variant, "-I", CORE, "-I", out, "-S", "-o", os.devnull, path]
        failed += subprocess.run([str(part) for part in command], check=False).returncode != 0
    print(f"{board}: {len(jobs)} translations, {failed} failed; {len(complaints)} settings without effect")
    return failed + len(complaints)


def main() -> int:
    try:
        idf, cc = idf_path(), compiler()
        system = [part for path in header_directories(idf) for part in ("-isystem", str(path))]
        version = subprocess.run([*cc, "--version"], capture_output=True, text=True, check=True).stdout
        print(f"{idf}: {shlex.join(cc)}, {version.splitlines()[0]}")
        start = [*cc, *STRICT, *DEFINES, *system]
        complaints = check_partitions(idf)
        complaints += sum(check(name, idf, start, *board) for name, board in boards().items())
        return int(complaints > 0)
    except Missing as missing:
        print(f"idf-check: missing: {missing}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
