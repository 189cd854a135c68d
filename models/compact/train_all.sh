#!/bin/sh
# Lessons, both networks and their export, or what is missing of it, in the folder it is called from: DATA holds the train and val
# captures (`models/render`, 256 × 256), CAPTURECTL is the program. Light is taught on surfaces that are already corrected, so the
# program is built once between the two. Run it again to go on.
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

train() { # NETWORK FOLDERS' SUFFIX OPTIONS…
    network=$1 suffix=$2
    shift 2
    python3 -m models.compact.train "$network" --lessons "lessons/train$suffix" --out compact-run \
        --val "lessons/val-clean$suffix" "lessons/val-noisy$suffix" "lessons/val-life$suffix" "$@"
}

course() { # SUFFIX OPTIONS…
    suffix=$1
    shift
    lessons "train$suffix" train --spoil "$@"
    lessons "val-clean$suffix" val "$@"
    lessons "val-noisy$suffix" val --noisy "$@"
    lessons "val-life$suffix" val --spoil --seed 5 "$@"
}

course ""
train surfaces "" --minutes 20
python3 -m models.compact.export compact-run --network surfaces --out "$root/models/weights"
(cd "$root" && cargo build)
course -corrected --corrected
train light -corrected --minutes 20
python3 -m models.compact.export compact-run --network light --out "$root/models/weights"
