#!/usr/bin/env bash
# A mesh of a picture with curl: examples/mesh.sh PICTURE [QUERY]
set -euo pipefail

url=${PIXMESH_URL:-http://127.0.0.1:8080}
picture=$1
query=${2:-density=2}
key=()
[[ -z ${PIXMESH_KEY:-} ]] || key=(-H "Authorization: Bearer $PIXMESH_KEY")

headers=$(mktemp)
trap 'rm -f "$headers"' EXIT

# The body of a refusal says what is wrong, so it is printed instead of the mesh. Where the service is
# busy, curl waits as long as the answer's Retry-After says.
status=$(curl --silent --show-error --retry 5 "${key[@]}" --data-binary "@$picture" \
    --dump-header "$headers" --output mesh.model --write-out '%{http_code}' "$url/v1/meshes?$query")
if [[ $status != 200 ]]; then
    cat mesh.model >&2
    rm mesh.model
    exit 1
fi
grep -i '^mesh-' "$headers"
