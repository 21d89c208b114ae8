#!/usr/bin/env bash
# A render as a Slurm job array: each task renders its share of the samples into a film. Preempted or out of time, a task goes
# back into the queue and goes on from its checkpoint. Merge the films when the array is done:
#
#   sbatch --array=1-16 scripts/slurm-array.sh scene.pbrt out --spp 4096
#   wavepath merge -o picture.exr out/part-*.film
#
#SBATCH --job-name=wavepath
#SBATCH --ntasks=1
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:USR1@120
set -uo pipefail
# Signals go to this shell (B: above), which waits for the render in the background and hands them on.
render=
hand_on() { [ -z "$render" ] || kill "-$1" "$render"; }
trap 'hand_on USR1' USR1
trap 'hand_on TERM' TERM
if [ $# -lt 2 ]; then
    echo "usage: sbatch --array=1-N $0 SCENE FOLDER [OPTIONS OF RENDER]" >&2
    exit 2
fi
scene=$1 out=$2
shift 2
part=${SLURM_ARRAY_TASK_ID:?runs as a job array: sbatch --array=1-N} parts=${SLURM_ARRAY_TASK_COUNT:?}
mkdir -p "$out"
film=$out/part-$part.film new=$out/new-$part.film
if [ -e "$film" ]; then
    echo "$film is there"
    exit 0
fi
"${WAVEPATH:-wavepath}" render "$scene" "$@" --threads "${SLURM_CPUS_PER_TASK:-$(nproc)}" --part "$part/$parts" \
    --checkpoint "$out/checkpoint-$part.film" --checkpoint-until-done --resume-if-there -o "$new" &
render=$!
wait $render
status=$?
# A signal ends `wait`, and not the render: its own status is what a last one says, if there was one.
while kill -0 $render 2>/dev/null; do
    wait $render
    status=$?
done
wait $render 2>/dev/null
last=$?
[ $last -eq 127 ] || status=$last
if [ $status -gt 128 ]; then
    rm -f "$new"
    echo "interrupted with status $status: back into the queue"
    scontrol requeue "${SLURM_ARRAY_JOB_ID:-$SLURM_JOB_ID}_$part"
    exit 0
fi
[ $status -eq 0 ] || exit $status
# The film appears when it is whole, so that what is there is done.
mv "$new" "$film"
