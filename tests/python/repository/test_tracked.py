"""Words that no file of the repository may contain."""

import re
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest

# Split in two where the word would otherwise be found in this file.
FORBIDDEN = {
    "a path of one machine": r"(?<![\w.])/(?:work|root|farm|home/\w+|tm" + r"p/\w)",
    "unfinished work": r"\b(?:TO" + r"DO|FIX" + r"ME|XX" + r"X)\b",
    "a stub": r"\b(?:to" + r"do|unimple" + r"mented)!\(|NotImplemented" + "Error",
    "a test switched off": r"mark\.(?:sk" + r"ip|xf" + r"ail)|#\[ign" + r"ore",
    "a package registry": r"\b(?:pypi\.org|python" + r"hosted|crates" + r"\.io)\b",
    "a tracker's number": r"(?i)\b(?:issue|ticket|session) #?\d+\b",
    "a folder outside": r"\.\./shar" + "ed",
}
# cargo writes the name of its index; a licence is quoted verbatim.
EXEMPT = {"Cargo.lock": {"a package registry"}, "LICENSE-APACHE": set(FORBIDDEN)}


def violations(files: Mapping[str, str]) -> list[str]:
    """`file:line: text` for each forbidden word."""
    found = []
    for name, text in sorted(files.items()):
        for what, pattern in FORBIDDEN.items():
            if what in EXEMPT.get(name, ()):
                continue
            found += [
                f"{name}:{text.count(chr(10), 0, m.start()) + 1}: {what}: {m[0]}"
                for m in re.finditer(pattern, text)
            ]
    return found


def test_tracked_files(repository: Path) -> None:
    # Untracked files too, unless ignored: they may be in the next commit.
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=repository,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split("\0")
    files = {}
    for name in filter(None, listed):
        path = repository / name
        if not path.is_file():
            continue  # removed, not yet committed
        content = path.read_bytes()
        if b"\0" not in content:
            files[name] = content.decode()
    assert "Makefile" in files
    assert violations(files) == []


def test_lock_file_names_one_registry(repository: Path) -> None:
    # A mirror of one machine in the lock file breaks the build on all others.
    sources = set(
        re.findall(r'^source = "(.*)"$', (repository / "Cargo.lock").read_text(), re.M)
    )
    assert sources == {"registry+https://github.com/rust-lang/crates" + ".io-index"}


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("open('/wo" + "rk/a')", "a path of one machine"),
        ("see /tm" + "p/x", "a path of one machine"),
        ("# TO" + "DO: later", "unfinished work"),
        ("to" + "do!()", "a stub"),
        ("@pytest.mark.sk" + "ip", "a test switched off"),
        ("https://crates" + ".io/x", "a package registry"),
        ("as iss" + "ue 12 asks", "a tracker's number"),
        ("see ../shar" + "ed/x", "a folder outside"),
    ],
)
def test_a_planted_violation_is_seen(text: str, what: str) -> None:
    (found,) = violations({"a.txt": "good\n" + text})
    assert found.startswith(f"a.txt:2: {what}: ")


def test_similar_words_are_allowed() -> None:
    assert (
        violations({"a.md": "frame/work/x, homework, target/root, https://a/b"}) == []
    )
