#!/bin/sh
# Makes the reference images of the scenes, 64x64, in references/: by the megakernel with independent random numbers and
# a seed of its own, so that the wavefront and its Sobol points are held against something that shares neither.
#
#   scenes/make-references.sh [SCENE ...]     all of them take about a quarter of an hour on two cores
#
# WAVEPATH names the program, if it should not be built here. tests/scenes.rs compares.
set -eu
cd "$(dirname "$0")"
WAVEPATH=${WAVEPATH:-cargo run --quiet --release --}
wanted=" $* "
mkdir -p references

# scene, samples a pixel. The samples are chosen for the estimated relMSE in the third column.
while read -r scene spp relmse; do
    case $wanted in "  " | *" $scene "*) ;; *) continue ;; esac
    echo "$scene: $spp samples a pixel, relMSE about $relmse"
    $WAVEPATH render "$scene.pbrt" -o "references/$scene.exr" --resolution 64x64 --spp "$spp" \
        --engine megakernel --sampler independent --seed 20011 --quiet </dev/null
done <<END
two-spheres       4096 4e-6
oren-nayar        8192 1.1e-5
inside-emitter    8192 1.4e-5
sky-only          8192 2e-5
cornell          24576 4.5e-5
glass-pane       32768 3e-5
depth-of-field   16384 7e-5
metals           24576 8e-5
spotlight        65536 1.2e-4
many-lights      49152 1.3e-4
wineglass        32768 1.4e-4
caustics         65536 2e-4
END
