#!/bin/sh
# Installs what models/render needs on Debian 12: LLVM 19 (Mitsuba aborts with Debian's 14 to 16) and the Python packages.
set -eu
here=$(dirname "$0")
apt-get update
apt-get install --yes libllvm19
python3 -m pip install --requirement "$here/requirements.txt"
