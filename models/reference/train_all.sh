#!/bin/sh
# Trains every network of the table on the unified set, two at a time on one thread each, or goes on where it was stopped.
# train_all.sh DATA RUN [MINUTES]: MINUTES (120) are those of the longest trainings, ShadowNet's and DecomposeNet's on clean depth.
set -eu
data=$1 run=$2 minutes=${3:-120}
cd "$(dirname "$0")/../.."

part() { echo "$((minutes * $1 / 100 + 1))m"; }
train() { python3 -m models.reference.train "$@" --val "$data/val-128" --out "$run" --bfloat16 --threads 1; }
all="$data/train-128 $data/train-256 $data/cheap-128"
lit="$data/train-128 $data/train-256"
long="--phase 64:4:$(part 45) --phase 128:2:$(part 45) --phase 256:2:$(part 10)"
short="--rate 2e-4 --phase 64:4:$(part 10) --phase 128:2:$(part 15)"

train shadow --train $all $long &
train decompose --train $all $long
wait
(
    train shadow --variant noisy --train $all --warm "$run/shadow-clean.pt" $short
    train decompose --variant sips --train $all --warm "$run/decompose-clean.pt" $short
    train decompose --variant env --train $lit --warm "$run/decompose-clean.pt" $short
) &
train synthesis --train $lit --phase 64:4:$(part 25) --phase 128:2:$(part 25)
train decompose --variant noisy --train $all --warm "$run/decompose-clean.pt" $short
wait
train synthesis --variant noisy --train $lit --warm "$run/synthesis-clean.pt" $short &
train synthesis --variant oss --train $lit --phase 64:4:$(part 15) --phase 128:2:$(part 15)
wait
