#!/usr/bin/env bash
# make fuzz: the C under libFuzzer and sanitizers, then C beside Python. INPUTS (default 1,000,000) is the number of each.
set -euo pipefail
cd "$(dirname "$0")/../.."
inputs=${INPUTS:-1000000}
work=build/fuzz
core=esp32_firmware/lib/radio_core
command -v clang >/dev/null || { echo "make fuzz: clang was not found: install it (Debian: apt install clang)" >&2; exit 1; }
mkdir -p "$work"
PYTHONPATH=tests/firmware ${PYTHON:-.venv/bin/python} tests/firmware/fuzz_corpus.py "$work/corpus"

# target, share of the inputs in percent
for job in "fuzz_frame 60" "fuzz_air 25" "fuzz_usb 15"; do
    read -r target share <<<"$job"
    clang -std=c11 -g -O1 -fno-omit-frame-pointer -Wall -Wextra -Werror -I "$core" \
        -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all \
        "esp32_firmware/fuzz/$target.c" "$core"/*.c -o "$work/$target"
    found=esp32_firmware/fuzz/found/$target
    mkdir -p "$work/new/$target"
    echo "$target: $((inputs * share / 100)) inputs"
    "$work/$target" -runs=$((inputs * share / 100)) -seed=1 -max_len=2048 -verbosity=0 -print_final_stats=1 \
        -artifact_prefix="$work/" "$work/new/$target" "$work/corpus/$target" $([ -d "$found" ] && echo "$found") \
        2>&1 | tee "$work/$target.log" | grep -E "ERROR|SUMMARY|executed_units|new_units" || true
    grep -q "number_of_executed_units" "$work/$target.log" && ! grep -q "SUMMARY" "$work/$target.log" ||
        { echo "make fuzz: $target failed: see $work/$target.log and the input beside it" >&2; exit 1; }
done
PYTHONPATH=tests/firmware ${PYTHON:-.venv/bin/python} tests/firmware/fuzz_agree.py "$inputs" 1 "$work/new"
echo "make fuzz: no findings"
