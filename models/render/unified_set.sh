#!/bin/sh
# Renders the unified set into a folder, or what is missing of it: about three CPU-hours, 8 GB. Needs what
# `setup.sh assets` installs. Run it again to go on.
set -eu
data=$1
jobs=${2:-2}
cd "$(dirname "$0")/../.."
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 # numpy's threads and the jobs would wait for each other

render() { python3 -m models.render --jobs "$jobs" "$@"; }
shards() { render --as shards --split train "$@"; }
cheap() { shards --out "$data/cheap-128" --shard 50 --size 128 --lights 8 --no-relit --ambient-every 0 --indirect-side 1 "$@"; }

render --as shards --out "$data/val-128" --split val --start 1000 --count 40 --shard 40 --size 128 --ambient-every 2
cheap --start 10000 --count 1500
shards --out "$data/train-128" --size 128 --ambient-every 2 --count 400
shards --out "$data/train-128" --size 128 --ambient-every 2 --start 1000 --count 400 --packaged 0.4
render --out "$data/test" --split test --size 256 --ambient-every 1 --count 20 --environments 1
render --out "$data/test" --split test --size 256 --ambient-every 1 --count 100
render --out "$data/other" --split other --size 256 --ambient-every 1 --count 60
cheap --start 20000 --count 1600 --packaged 0.4
shards --out "$data/train-256" --size 256 --ambient-every 2 --start 2000 --count 250 --packaged 0.4
render --out "$data/val" --split val --size 256 --count 40
