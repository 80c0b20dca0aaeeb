#!/usr/bin/env bash
# Saves a mesh of a picture with curl, in mesh.model or in a file of the format asked for.
set -euo pipefail

if (($# < 1 || $# > 2)); then
    echo "usage: examples/mesh.sh PICTURE [QUERY]" >&2
    exit 2
fi
url=${PIXMESH_URL:-http://127.0.0.1:8080}
picture=$1
query=${2:-density=2}
format=model
[[ ! $query =~ (^|&)format=([a-z]+) ]] || format=${BASH_REMATCH[2]}
key=()
[[ -z ${PIXMESH_KEY:-} ]] || key=(-H "Authorization: Bearer $PIXMESH_KEY")

# The answer goes to a folder of its own, so that a former mesh stays until the new one is whole.
parts=$(mktemp -d ./mesh.XXXXXX)
trap 'rm -r "$parts"' EXIT

# Where the service is busy, curl waits as long as the answer's Retry-After says.
if ! curl --silent --show-error --retry 5 --fail-with-body "${key[@]}" --data-binary "@$picture" \
    --dump-header "$parts/headers" --output "$parts/mesh" "$url/v1/meshes?$query"; then
    # The body of a refusal says what is wrong.
    [[ ! -e $parts/mesh ]] || cat "$parts/mesh" >&2
    exit 1
fi
mv "$parts/mesh" "mesh.$format"
grep -i '^mesh-' "$parts/headers"
