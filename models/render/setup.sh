#!/bin/sh
# Installs what models/render needs on Debian 12: LLVM 19 (Mitsuba aborts with Debian's 14 to 16) and the Python packages.
# `setup.sh assets` also installs the packaged meshes and textures (2.4 GB to download; see LICENCES.md).
set -eu
here=$(dirname "$0")
apt-get update
apt-get install --yes libllvm19
if [ "${1-}" = assets ]; then
    apt-get install --yes --no-install-recommends 0ad-data redeclipse-data sweethome3d-furniture
fi
python3 -m pip install --requirement "$here/requirements.txt"
