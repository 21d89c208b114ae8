#!/usr/bin/env bash
# A render in parts on several machines, by GNU parallel over ssh: dealt out as machines become free, again where one fails.
# All machines see scene and folder under the same path, and have wavepath in theirs.
#
#   scripts/parallel-ssh.sh hosts scene.pbrt out 32 --spp 4096
#
# `hosts` has a machine a line, as parallel takes it: `1/user@host`, one render at once; `:` is this machine. Run it again
# to render what is missing. Then: wavepath merge -o picture.exr out/part-*.film
set -euo pipefail
if [ $# -lt 4 ]; then
    echo "usage: $0 HOSTS SCENE FOLDER PARTS [OPTIONS OF RENDER]" >&2
    exit 2
fi
hosts=$1 scene=$(realpath "$2") out=$3 parts=$4
shift 4
mkdir -p "$out"
out=$(realpath "$out")
# A film appears when it is whole: a part whose film is there is done. The checkpoint is there for who runs a part again.
options=
for word in "$@"; do options+=" $(printf %q "$word")"; done
program=$(printf %q "${WAVEPATH:-wavepath}") scene=$(printf %q "$scene") folder=$(printf %q "$out")
part="film=$folder/part-{}.film checkpoint=$folder/checkpoint-{}.film new=$folder/new-{}.film
[ -e \"\$film\" ] || {
    $program render $scene$options --quiet --part {}/$parts --checkpoint \"\$checkpoint\" --checkpoint-until-done \\
        --resume-if-there -o \"\$new\" && mv \"\$new\" \"\$film\"
}"
seq 1 "$parts" | parallel --sshloginfile "$hosts" --retries 3 --halt never --joblog "$out/joblog" "$part"
