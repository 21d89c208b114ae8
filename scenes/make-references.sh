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

# scene, samples a pixel, and the relMSE that the report in the file estimates (strings FILE | grep relmse).
while read -r scene spp relmse; do
    case $wanted in "  " | *" $scene "*) ;; *) continue ;; esac
    echo "$scene: $spp samples a pixel, relMSE about $relmse"
    $WAVEPATH render "$scene.pbrt" -o "references/$scene.exr" --resolution 64x64 --spp "$spp" \
        --engine megakernel --sampler independent --seed 20011 --quiet </dev/null
done <<END
two-spheres     131072 1.3e-7
oren-nayar        8192 1.2e-5
inside-emitter    8192 1.4e-5
textures          8192 1.1e-5
sky-only          8192 2e-5
cornell          24576 5e-5
glass-pane       16384 6e-5
depth-of-field   12288 1.1e-4
metals           16384 1.3e-4
spotlight        24576 2.3e-4
many-lights      24576 3e-4
wineglass        16384 3.5e-4
caustics         24576 6.6e-4
END
