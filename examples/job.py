"""Saves a mesh of a picture in mesh.glb, made as a job, with nothing but Python's own library."""

import hashlib
import json
import os
import sys
import time
import urllib.error
import urllib.parse
import urllib.request

URL = os.environ.get("PIXMESH_URL", "http://127.0.0.1:8080")
ATTEMPTS = 5
FINAL = {"completed", "failed", "cancelled"}


class Refused(Exception):
    """A problem document (RFC 9457), as a dictionary in `problem`."""

    def __init__(self, problem):
        super().__init__(f"{problem['title']}: {problem['detail']}")
        self.problem = problem


def call(path, method="GET", body=None, headers=()):
    """An open answer; where the service is busy it is asked again after as long as it says."""
    request = urllib.request.Request(URL + path, data=body, method=method, headers=dict(headers))
    if key := os.environ.get("PIXMESH_KEY"):
        request.add_header("Authorization", f"Bearer {key}")
    for attempt in range(ATTEMPTS):
        try:
            return urllib.request.urlopen(request)
        except urllib.error.HTTPError as refusal:
            problem = json.load(refusal)
            wait_s = refusal.headers.get("Retry-After")
            if wait_s is None or attempt == ATTEMPTS - 1:
                raise Refused(problem) from None
            time.sleep(int(wait_s))


def submit(picture, **parameters):
    """The path of the job that makes a mesh of a picture's bytes.

    The same picture and parameters are the same job for a day, however often this is called.
    """
    query = urllib.parse.urlencode(sorted(parameters.items()))
    word = hashlib.sha256(query.encode() + b"\n" + picture).hexdigest()
    headers = {"Content-Type": "application/octet-stream", "Idempotency-Key": word}
    with call(f"/v1/jobs?{query}", "POST", picture, headers) as answer:
        return answer.headers["Location"]


def events(job):
    """What happens to a job, until its end; where the connection breaks, it goes on from there."""
    last, event = "", {}
    while event.get("state") not in FINAL:
        try:
            with call(f"{job}/events", headers={"Last-Event-ID": last} if last else {}) as stream:
                for line in map(bytes.decode, stream):
                    if line.startswith("id:"):
                        last = line[3:].strip()
                    elif line.startswith("data:"):
                        event = json.loads(line[5:])
                        yield event
        except (ConnectionError, urllib.error.URLError):
            time.sleep(1)


def save(name, body):
    """Writes a file; a former one of the name stays until the new one is whole."""
    part = name + ".part"
    with open(part, "wb") as file:
        file.write(body)
    os.replace(part, name)


def main():
    if len(sys.argv) == 1:
        print("usage: examples/job.py PICTURE [NAME=VALUE ...]", file=sys.stderr)
        sys.exit(2)
    path, *pairs = sys.argv[1:]
    with open(path, "rb") as file:
        picture = file.read()
    parameters = dict(pair.split("=", 1) for pair in pairs) or {"density": "2"}
    try:
        job = submit(picture, **parameters)
        for event in events(job):
            print(event["state"], event.get("progress") or "")
        with call(f"{job}/mesh?format=glb") as answer:
            body = answer.read()
        with call(job) as answer:
            mesh = json.load(answer)["mesh"]
    except Refused as refused:
        print(json.dumps(refused.problem), file=sys.stderr)
        sys.exit(1)
    save("mesh.glb", body)
    print(f"{mesh['vertices']} vertices, {mesh['faces']} faces, {mesh['psnr_db']:.2f} dB, {len(body)} bytes")


if __name__ == "__main__":
    main()
