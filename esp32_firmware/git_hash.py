"""Prints the build flag that names the commit a firmware was built from; the radio reports it to its host."""

import subprocess

try:
    answer = subprocess.run(
        ["git", "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True, check=True
    ).stdout
except (OSError, subprocess.CalledProcessError):
    answer = "unknown"
print(f"-DHIPPOMAT_GIT_HASH={answer.strip()[:8]}")
