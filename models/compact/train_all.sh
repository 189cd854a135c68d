#!/bin/sh
# Lessons, both networks and their export, or what is missing of it, in the folder it is called from: DATA holds the train and val
# captures (`models/render`, 256 × 256), CAPTURECTL is the program. Run it again to go on.
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
data=$1
program=${2:-$root/target/debug/capturectl}
export PYTHONPATH="$root" OMP_WAIT_POLICY=passive

lessons() { # FOLDER CAPTURES OPTIONS…
    out=$1 captures=$2
    shift 2
    "$program" lessons "$data/$captures"/[0-9]* --out "lessons/$out" "$@"
}

lessons train train --spoil
lessons val-clean val
lessons val-noisy val --noisy
lessons val-life val --spoil --seed 5
train() { # NETWORK OPTIONS…
    python3 -m models.compact.train "$@" --lessons lessons/train --out compact-run --val lessons/val-clean lessons/val-noisy lessons/val-life
}
train surfaces --minutes 30
train light --steps 10000 --rate 1e-3 --turned
python3 -m models.compact.export compact-run --out "$root/models/weights"
