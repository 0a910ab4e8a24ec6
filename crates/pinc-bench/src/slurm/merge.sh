#!/bin/sh
#SBATCH --job-name={name}-merge
#SBATCH --ntasks=1
{options}
# Writes tables and report of what is done, when no process works on the sweep any more.
set -eu
cd {place}
{modules}exec {program} merge {dir} --out {dir}
