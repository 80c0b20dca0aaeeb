#!/usr/bin/env bash
# A mesh of a picture as a job, with curl: examples/job.sh PICTURE [QUERY]
#
# The job survives this script and the service: give the same Idempotency-Key again, and the answer is
# the same job.
set -euo pipefail

url=${PIXMESH_URL:-http://127.0.0.1:8080}
picture=$1
query=${2:-density=2}
authorization=()
[[ -z ${PIXMESH_KEY:-} ]] || authorization=(-H "Authorization: Bearer $PIXMESH_KEY")

headers=$(mktemp)
trap 'rm -f "$headers"' EXIT

# call ARGUMENT...: prints the body; where the service refuses, says why and ends the script.
call() {
    curl --silent --show-error --retry 5 --fail-with-body "${authorization[@]}" "$@" || {
        [[ -z ${refusal:-} ]] || cat "$refusal" >&2
        exit 1
    }
}

word=$(sha256sum "$picture" | cut -c 1-32)-$(sha256sum <<<"$query" | cut -c 1-8)
refusal=job.json call -H "Idempotency-Key: $word" --data-binary "@$picture" \
    --dump-header "$headers" --output job.json "$url/v1/jobs?$query"
job=$(sed -n 's/^location: *\([^[:space:]]*\).*/\1/pI' "$headers")

# Each line of data is a change of state or progress; the stream ends with the job.
call --no-buffer "$url$job/events" | sed -n 's/^data: //p'

call --output mesh.model "$url$job/mesh?format=model"
call --output rebuilt.png "$url$job/mesh?format=png"
call "$url$job"
