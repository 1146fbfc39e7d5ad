"""The wheel as users get it, installed with its declared dependencies away from the repository: it answers and serves the page.

`make wheel-check` builds it and calls this: `python .ci/check_wheel.py WHEEL`.
"""

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
import venv
from pathlib import Path


def check(wheel: Path, folder: Path) -> None:
    """Install the wheel below the folder, and use it there."""
    venv.create(folder / "env", with_pip=True)
    programs = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
    hidden = ("PYTHONPATH", "NSDR_CHECKPOINTS")
    environment = {k: v for k, v in os.environ.items() if k not in hidden} | {"OMP_NUM_THREADS": "1"}

    def start(program: str, *arguments: str) -> subprocess.Popen[str]:
        print(program, *arguments, flush=True)
        command = [str(programs / program), *arguments]
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True)

    def run(program: str, *arguments: str) -> str:
        process = start(program, *arguments)
        output, _ = process.communicate()
        if process.returncode:
            raise SystemExit(f"{output}{program} failed: exit status {process.returncode}")
        return output.strip()

    run("pip", "install", "--quiet", "--no-compile", f"nsdr[web] @ {wheel.resolve().as_uri()}")
    print(run("pip", "check"))
    print(run("nsdr", "demo", "-o", "demo.png").splitlines()[-2])
    clip = run("python", "-c", "from nsdr.clevrer.example import VIDEO; print(VIDEO)")
    for options in ([], ["--config", "paper"], ["--system", "pixels/mac_objects"]):
        print(run("nsdr", "answer", clip, "How many collisions happen?", *options))

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    page = start("nsdr", "serve", "--port", str(port))
    try:
        assert page.stdout is not None
        if not page.stdout.readline():
            raise SystemExit("nsdr serve ended before its page was there")
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/config", timeout=60) as reply:
            print(f"The page is there: {len(json.load(reply)['components'])} components")
    finally:
        page.terminate()
        page.wait(60)


if __name__ == "__main__":
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="nsdr-wheel-", ignore_cleanup_errors=True) as place:
        check(Path(sys.argv[1]), Path(place))
    print(f"{sys.argv[1]}: works by itself ({time.monotonic() - started:.0f} s)")
