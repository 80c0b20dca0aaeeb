#!/usr/bin/env bash
# Saves a mesh of a picture, made as a job, in mesh.model with curl, and in rebuilt.png the picture
# that is rebuilt from it.
#
# The job survives this script and the service: give the same Idempotency-Key again, and the answer
# is the same job.
set -euo pipefail

if (($# < 1 || $# > 2)); then
    echo "usage: examples/job.sh PICTURE [QUERY]" >&2
    exit 2
fi
url=${PIXMESH_URL:-http://127.0.0.1:8080}
picture=$1
query=${2:-density=2}
authorization=()
[[ -z ${PIXMESH_KEY:-} ]] || authorization=(-H "Authorization: Bearer $PIXMESH_KEY")

# Answers go to a folder of their own, so that former files stay until the new ones are whole.
parts=$(mktemp -d ./job.XXXXXX)
trap 'rm -r "$parts"' EXIT

call() {
    curl --silent --show-error --retry 5 --fail-with-body "${authorization[@]}" "$@"
}

# fetch NAME ARGUMENT...: keeps the body; where the service refuses, says why and ends the script.
fetch() {
    local part=$parts/$1
    shift
    call --output "$part" "$@" || {
        [[ ! -e $part ]] || cat "$part" >&2
        exit 1
    }
}

word=$(sha256sum "$picture" | cut -c 1-32)-$(sha256sum <<<"$query" | cut -c 1-8)
fetch submitted -H "Idempotency-Key: $word" --data-binary "@$picture" \
    --dump-header "$parts/headers" "$url/v1/jobs?$query"
job=$(sed -n 's/^location: *\([^[:space:]]*\).*/\1/pI' "$parts/headers")

# Each line of data is a change of state or progress; the stream ends with the job.
call --no-buffer "$url$job/events" | sed -n 's/^data: //p'

fetch mesh.model "$url$job/mesh?format=model"
fetch rebuilt.png "$url$job/mesh?format=png"
mv "$parts/mesh.model" "$parts/rebuilt.png" .
call "$url$job"
