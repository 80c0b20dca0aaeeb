#!/usr/bin/env python3
"""Tries the mutants that `cargo gamma` has built into one program, each in processes of its own.

    tools/mutants/sweep.py CACHE RESULTS [--survivors-of RESULTS] [--also "PROGRAM ARGUMENTS"]

CACHE is the folder given to `cargo gamma run --cache-dir`. One line is written to RESULTS for each
mutant as soon as it is decided, and a mutant that has a line there is not tried again, so that a sweep
can be interrupted at any time.

A mutant has as much time as the tests take without one, times SLACK; that is measured in time of the
processor, so that other work on the machine makes no difference. First comes the test that caught the
last mutant of the same file, then the tests of the module, then all, then those of other programs in
which the same mutants are.
"""

import argparse
import json
import os
import re
import resource
import signal
import subprocess
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

SLACK = 3
# Seconds that any test may take in addition.
LEAST = 2
MEMORY = 4 << 30

# Tests of random cases try the same ones for each mutant, and need not look for the least that fails.
ENVIRONMENT = os.environ | {
    "PROPTEST_DISABLE_FAILURE_PERSISTENCE": "true",
    "PROPTEST_MAX_SHRINK_ITERS": "0",
    "PROPTEST_RNG_SEED": "1",
    "RUST_BACKTRACE": "0",
}


def end_group(group, how):
    """Ends what is left of a group of processes."""
    try:
        os.killpg(group, how)
    except ProcessLookupError:
        pass


class Program:
    """A program of tests with mutants in it."""

    def __init__(self, path, folder, threads, still, arguments=()):
        self.path, self.folder, self.arguments = path, folder, arguments
        self.threads, self.still = threads, still
        self.seconds = {}
        self.lock = threading.Lock()

    def run(self, mutant, arguments, seconds):
        """Runs tests with a mutant: the outcome, the test that failed, the processor's seconds."""

        def limit():
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

        command = [self.path, f"--test-threads={self.threads}", *arguments, *self.arguments]
        environment = ENVIRONMENT | {"GAMMA_ACTIVE": str(mutant)}
        process = subprocess.Popen(
            command, cwd=self.folder, env=environment, preexec_fn=limit, text=True,
            errors="replace", stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True,
        )
        still = threading.Timer(self.still, end_group, (process.pid, signal.SIGTERM))
        still.start()
        failed, last = None, None
        try:
            for line in process.stdout:
                named = re.match(r"test (\S+).* \.\.\. ", line)
                last = named[1] if named else last
                if named and line.rstrip().endswith("FAILED"):
                    failed = named[1]
                    break
        finally:
            still.cancel()
            if failed:
                end_group(process.pid, signal.SIGKILL)
            _, status, usage = os.wait4(process.pid, 0)
            # Servers that the tests started and did not live to end.
            end_group(process.pid, signal.SIGKILL)
            process.returncode = status = os.waitstatus_to_exitcode(status)
        if failed:
            return "caught", failed, 0
        if status in (-signal.SIGXCPU, -signal.SIGTERM, -signal.SIGKILL):
            return "timeout", last, 0
        if status:
            return "caught", f"status {status} after {last}", 0
        return "survived", None, usage.ru_utime + usage.ru_stime

    def limit(self, arguments):
        """The seconds that tests may take, of what they take without a mutant."""
        key = tuple(arguments)
        with self.lock:
            if key not in self.seconds:
                outcome, by, taken = self.run(0, arguments, 3600)
                if outcome != "survived":
                    raise RuntimeError(f"without a mutant {arguments}: {outcome} by {by}")
                self.seconds[key] = int(SLACK * taken) + LEAST
        return self.seconds[key]


def module(path):
    """The path of a source file's module, as tests are named."""
    inner = path.partition("src/")[2].removesuffix(".rs").removesuffix("/mod")
    return inner.replace("/", "::") + "::"


def decide(programs, mutant, killers, whole):
    """The outcome of a mutant, and the test that caught it."""
    own = module(mutant["file"])
    latest = killers.get(mutant["file"])
    stages = [(latest[0], ["--exact", latest[1]])] if latest else []
    stages += [(programs[0], [])] if whole else [(programs[0], [own]), (programs[0], ["--skip", own])]
    stages += [(program, []) for program in programs[1:]]
    for program, tests in stages:
        outcome, by, _ = program.run(mutant["ordinal"], tests, program.limit(tests))
        if outcome != "survived":
            if by and not by.startswith("status"):
                killers[mutant["file"]] = (program, by)
            return outcome, by
    return "survived", None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("cache", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--survivors-of", type=Path)
    parser.add_argument("--program", help="the first program, where not that of the unit tests")
    parser.add_argument("--file", default="", help="pattern of the files whose mutants are tried")
    parser.add_argument("--threads", type=int, default=1, help="tests at once in each process")
    parser.add_argument("--still", type=int, default=600, help="seconds by the clock for each process")
    parser.add_argument("--also", action="append", default=[], help="a program of more tests, and arguments")
    parser.add_argument("--tests", default="", help="arguments of the first program")
    parser.add_argument("--whole", action="store_true", help="those arguments name tests; no part of them goes first")
    parser.add_argument("--jobs", type=int, default=2, help="processes at once; many where tests mostly wait")
    options = parser.parse_args()

    session = json.loads((options.cache / "testing-session.json").read_text())
    binary = session["session"]["binaries"][0]
    commands = [[options.program or binary["path"], *options.tests.split()], *map(str.split, options.also)]
    programs = [
        Program(path, binary["manifest_dir"], options.threads, options.still, arguments)
        for path, *arguments in commands
    ]
    done = {line.split("\t")[0] for line in read(options.results)}
    wanted = None
    if options.survivors_of:
        lines = (line.split("\t") for line in read(options.survivors_of))
        wanted = {line[0] for line in lines if line[1] == "survived"}
    mutants = [m for m in session["plan"]["mutants"] if m["id"] not in done]
    if wanted is not None:
        mutants = [m for m in mutants if m["id"] in wanted]
    mutants = [m for m in mutants if re.search(options.file, m["file"])]
    killers = {}
    with options.results.open("a") as results, ThreadPoolExecutor(options.jobs) as pool:

        def one(mutant):
            viable = mutant["outcome"] in ("Pending", "Survived", "Killed")
            outcome, by = mutant["outcome"].lower(), None
            if viable:
                outcome, by = decide(programs, mutant, killers, options.whole)
            place = f"{mutant['file']}:{mutant['line']}:{mutant['column']}"
            change = f"{' '.join(mutant['original'].split())[:60]} -> {mutant['replacement'][:60]!r}"
            fields = [mutant["id"], outcome, place, mutant["mutator"], mutant["item_path"] or "", change]
            results.write("\t".join([*fields, by or ""]) + "\n")
            results.flush()

        for done in [pool.submit(one, mutant) for mutant in mutants]:
            done.result()


def read(path):
    return path.read_text().splitlines() if path.exists() else []


if __name__ == "__main__":
    main()
