#!/bin/sh
#SBATCH --job-name={name}
#SBATCH --array=1-{jobs}
#SBATCH --ntasks=1
#SBATCH --requeue
#SBATCH --open-mode=append
{options}
# One of {jobs} processes that work on the sweep together, each beginning with its own share. It may be
# stopped and started again at any time. By hand, or from another scheduler: sh work.sh 3
set -eu
cd {place}
{modules}share=${SLURM_ARRAY_TASK_ID:-${PBS_ARRAY_INDEX:-${HQ_TASK_ID:-${1:?which share, 1 to {jobs}}}}}
exec {program} run {config} --out {dir} --shared --resume --shard "$share/{jobs}"
