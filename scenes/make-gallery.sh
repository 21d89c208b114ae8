#!/bin/sh
# Renders the pictures of the README into docs/gallery/.
#
#   scenes/make-gallery.sh          all of them; about ten minutes on two cores
#   scenes/make-gallery.sh NAME ... those only
#
# The scenes marked "large" need their meshes: scenes/make-meshes.sh large. They are made if they are missing.
# WAVEPATH names the program, if it should not be built here.
set -eu
cd "$(dirname "$0")"
WAVEPATH=${WAVEPATH:-cargo run --quiet --release --}
wanted=" $* "
mkdir -p ../docs/gallery

# scene, size, samples a pixel
while read -r scene size spp; do
    case $wanted in "  " | *" $scene "*) ;; *) continue ;; esac
    case $scene in
        terrain | julia) mesh=$scene ;;
        menger) mesh=menger-4 ;;
        *) mesh= ;;
    esac
    if [ -n "$mesh" ] && [ ! -f "meshes/generated/$mesh.ply" ]; then
        ./make-meshes.sh large </dev/null
    fi
    echo "$scene: $size, $spp samples a pixel"
    $WAVEPATH render "$scene.pbrt" -o "../docs/gallery/$scene.png" --resolution "$size" --spp "$spp" --quiet </dev/null
done <<END
cornell         400x400 512
wineglass       320x320 768
caustics        400x300 768
metals          480x240 512
terrain         480x270 128
julia           320x320 128
menger          320x320 256
many-lights     400x300 256
depth-of-field  480x270 256
glass-pane      400x250 256
spotlight       400x300 256
oren-nayar      400x300 128
inside-emitter  320x320 256
sky-only        400x300 256
END
