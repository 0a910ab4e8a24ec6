#!/bin/sh
# Submits the work, and after it, however it ended, the merge. Prints the numbers of the two jobs.
set -eu
cd {place}
work=$(sbatch --parsable --output={folder}/work-%a.log {folder}/work.sh)
work=${work%%;*}
echo "$work" > {folder}/jobs
merge=$(sbatch --parsable --dependency="afterany:$work" --output={folder}/merge.log {folder}/merge.sh)
merge=${merge%%;*}
echo "$work $merge" > {folder}/jobs
echo "$work $merge"
