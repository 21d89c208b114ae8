#!/bin/sh
# Renders the pictures of the README into docs/gallery/.
#
#   scenes/make-gallery.sh          all of them; about twenty minutes on two cores
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
cornell         400x400 1024
wineglass       320x320 1536
caustics        400x300 1536
metals          480x240 1024
terrain         480x270 256
julia           320x320 256
menger          320x320 512
many-lights     400x300 512
depth-of-field  480x270 512
glass-pane      400x250 512
spotlight       400x300 512
oren-nayar      400x300 128
inside-emitter  320x320 256
sky-only        400x300 256
END
