"""Make the accuracy pages of a release: ``python reports/release.py``, or ``--check`` that they are of this code.

The pages are of this code if ``release.json`` has the digest of its sources: every file of ``insnav/`` and
``trajectories/`` that git tracks, by name and content. A change of one byte makes the pages old.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from insnav.version import __version__

ROOT = Path(__file__).parents[1]
RECORD = ROOT / "reports" / "release.json"
CERTIFICATE = ROOT / "reports" / "certificate.md"
INSNAV = (sys.executable, "-m", "insnav")
STEPS = (  # an hour
    (*INSNAV, "regress", "--plot"),
    (sys.executable, "reports/peers.py"),
    (*INSNAV, "verify", "--markdown", "--force", "--out", str(Path(tempfile.gettempdir()) / "insnav_certificate")),
    (sys.executable, "reports/pictures.py"),
    (sys.executable, "reports/faults.py"),
)
PAGES = (
    *("reports/accuracy.md", "reports/accuracy.html", "reports/certificate.md"),
    *("reports/peers.html", "reports/published.md"),
    *("reports/sample_position_error.png", "reports/sample_run_page.png", "reports/sample_budget.png"),
    "docs/accuracy/faults.md",
)


def digest(root: Path, names: list[str]) -> str:
    """Return the SHA-256 of files, by name and content."""
    total = hashlib.sha256()
    for name in sorted(names):
        total.update(f"{name}\0{hashlib.sha256((root / name).read_bytes()).hexdigest()}\n".encode())
    return total.hexdigest()


def sources() -> list[str]:
    """List the files of the package and of its drives."""
    asked = ("git", "ls-files", "-z", "insnav", "trajectories")
    return subprocess.run(asked, cwd=ROOT, capture_output=True, check=True, encoding="utf-8").stdout.split("\0")[:-1]


def stale(root: Path, record: Path, names: list[str]) -> list[str]:
    """List the pages that are not as made, or all of them if the sources have changed since."""
    if not record.exists():
        return list(PAGES)
    made = json.loads(record.read_text(encoding="utf-8"))
    if made["sources"] != digest(root, names):
        return list(PAGES)
    return [page for page in PAGES if not (root / page).exists() or made["pages"].get(page) != digest(root, [page])]


def make() -> None:
    """Run the steps, and record the digests of sources and pages."""
    before = digest(ROOT, sources())
    for step in STEPS:
        print("$", *step[1:], flush=True)
        done = subprocess.run(step, cwd=ROOT, stdout=subprocess.PIPE, check=True, encoding="utf-8")
        if "--markdown" in step:
            head = CERTIFICATE.read_text(encoding="utf-8").partition("| check |")[0]
            head = re.sub(r"Version \S+:", f"Version {__version__}:", head)
            CERTIFICATE.write_text(head + done.stdout, encoding="utf-8")
    if digest(ROOT, sources()) != before:
        sys.exit("The sources changed meanwhile: run it again.")
    pages = {page: digest(ROOT, [page]) for page in PAGES}
    RECORD.write_text(json.dumps({"sources": before, "pages": pages}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if "--check" not in sys.argv[1:]:
        make()
    if old := stale(ROOT, RECORD, sources()):
        sys.exit("Older than the code: " + ", ".join(old) + "\nMake them again: python reports/release.py")
