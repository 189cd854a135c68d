#!/bin/sh
# Designs of LightNet, 2000 steps each, on the lessons that `train_all.sh` left in the folder it is called from: trains what is not
# trained yet, then prints the table and draws the chart. CAPTURES are those that the lessons of training were made of, PROGRAM is
# capturectl, LIBRARY is ONNX Runtime's: for the shadows of the paper's networks that one design learns from.
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
captures=$1 program=$2 library=$3
val="lessons/val-clean lessons/val-noisy lessons/val-life"
export PYTHONPATH="$root" OMP_WAIT_POLICY=passive

design() { # NAME OPTIONS…
    out=designs/$1
    shift
    [ -e "$out/light.pt" ] || python3 -m models.compact.train light --lessons lessons/train --val $val --out "$out" \
        --steps 2000 --threads 1 --look-minutes 600 "$@"
}

half="--patch 2 --widths 12 24 48 64"
quarter="--patch 4 --widths 24 48 64 96 --rate 1e-3"
design half $half
for seed in 1 2 3; do design quarter-seed$seed $quarter --seed $seed; done
design quarter-turned $quarter --turned
design quarter-small --patch 4 --widths 16 32 64 --rate 1e-3
design quarter-large --patch 4 --widths 32 64 96 128 --rate 1e-3
for folder in train val-clean val-noisy val-life; do
    [ -e lessons/$folder/.distance ] || { python3 -m models.compact.distance lessons/$folder && touch lessons/$folder/.distance; }
done
design quarter-distance $quarter --with-distance
design quarter-small-taught --patch 4 --widths 16 32 64 --rate 1e-3 --teacher designs/quarter-large/light.pt
python3 -m models.compact.told lessons/train --captures "$captures" --program "$program" --runtime "$library"
design quarter-told-by-paper $quarter --told
python3 -m models.compact.designs designs --val $val --out "$root/docs/eval/designs"
