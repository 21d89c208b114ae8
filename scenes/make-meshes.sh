#!/bin/sh
# Makes the meshes of the scenes.
#
#   scenes/make-meshes.sh         the small ones in scenes/meshes/, which are committed
#   scenes/make-meshes.sh large   the large ones in scenes/meshes/generated/, which are not: as their scenes say in a
#                                 comment, by which `wavepath render` makes them when they are missing
#
# WAVEPATH names the program, if it should not be built here. A test reads the lines that begin with "mesh" and holds
# the committed files to what they make.
set -eu
cd "$(dirname "$0")"
WAVEPATH=${WAVEPATH:-cargo run --quiet --release --}
mesh() { $WAVEPATH mesh "$@"; }

if [ "${1:-}" = large ]; then
    mkdir -p meshes/generated
    sed -n 's/^# made by: wavepath mesh //p' ./*.pbrt | while read -r line; do
        # shellcheck disable=SC2086 # words of a command
        $WAVEPATH mesh $line </dev/null
    done
    exit
fi

mesh torus-knot --p 2 --q 3 --segments 240 --sides 22 -o meshes/knot.ply
mesh lathe --profile wine-glass --sides 64 --steps 3 -o meshes/wine-glass.ply
mesh lathe --profile vase --sides 40 --steps 2 -o meshes/vase.ply
mesh lathe --profile pawn --sides 32 --steps 3 -o meshes/pawn.ply
mesh gear --teeth 16 --segments 3 -o meshes/gear.ply
mesh displaced-sphere --frequency 28 --relief 0.03 --craters 220 --seed 7 -o meshes/moon.ply
mesh sphere-flake --levels 2 --frequency 4 -o meshes/flake.ply
mesh menger --levels 2 -o meshes/menger.ply
mesh superellipsoid --north 0.35 --east 0.35 --cells 14 -o meshes/pillow.ply
mesh box --rounding 0.08 --segments 3 -o meshes/block.ply
