#!/usr/bin/env bash
# Wavefront against megakernel: samples per second of rendering, as a ratio, in interleaved rounds of one thread each.
#
#   benches/engines.sh [SCENE.pbrt ...]      ROUNDS=5 SPP=4 WAVEPATH=target/release/wavepath
#
# Without scenes: those that ship and whose meshes are there. Prints the median ratio and the smallest and largest one.
set -euo pipefail
here=$(cd "$(dirname "$0")/.." && pwd)
program=${WAVEPATH:-$here/target/release/wavepath}
rounds=${ROUNDS:-5} spp=${SPP:-4}
[ -x "$program" ] || cargo build --release --manifest-path "$here/Cargo.toml"
scenes=("$@")
if [ ${#scenes[@]} -eq 0 ]; then
    for name in cornell glass-pane oren-nayar many-lights metals wineglass caustics depth-of-field sky-only \
        inside-emitter menger julia terrain; do
        scenes+=("$here/scenes/$name.pbrt")
    done
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
rate() { # engine, scene: samples per second
    "$program" render "$2" --engine "$1" --threads 1 --spp "$spp" --sampler sobol --quiet -o "$work/image.exr" \
        --report "$work/report.json" 2>"$work/errors" || return 1
    tr -d '",' <"$work/report.json" | awk '$1 == "seconds:" { t = $2 } $1 == "samples:" { n = $2 } END { print n / t }'
}
printf '| scene | wavefront / megakernel | spread |\n|---|---|---|\n'
for scene in "${scenes[@]}"; do
    for ((round = 0; round < rounds; round++)); do
        wavefront=$(rate wavefront "$scene") || { sed 1q "$work/errors" >&2; continue 2; }
        megakernel=$(rate megakernel "$scene")
        awk -v w="$wavefront" -v m="$megakernel" 'BEGIN { print w / m }'
    done | sort -g >"$work/ratios"
    [ -s "$work/ratios" ] || continue
    awk -v scene="$(basename "$scene" .pbrt)" '{ r[NR] = $1 } END {
        median = NR % 2 ? r[(NR + 1) / 2] : (r[NR / 2] + r[NR / 2 + 1]) / 2
        printf "| %s | %.1f | %.1f to %.1f |\n", scene, median, r[1], r[NR] }' "$work/ratios"
done
