"""The fenced blocks of the README and of the pages in docs: files, commands, and what these print."""

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r'(?:<!-- (not run|slow)[^>]*-->\n)?```(\w*)(?: title="([^"\n]+)")?\n(.*?)```\n', re.DOTALL)


class Block(NamedTuple):
    """A fenced block: what stands before it ("not run", "slow" or nothing), its language, its file's name, its text."""

    mark: str
    language: str
    file: str
    text: str

    @property
    def commands(self) -> list[str]:
        """The lines that a reader types."""
        if self.language == "console":
            return [line.removeprefix("$ ") for line in self.text.splitlines() if line.startswith("$ ")]
        return [line for line in self.text.splitlines() if line.strip()] if self.language == "sh" else []

    @property
    def printed(self) -> str:
        """What is printed, as far as the page shows it."""
        return "\n".join(line for line in self.text.splitlines() if not line.startswith("$ ")).strip()


def blocks_of(page: Path) -> list[Block]:
    return [Block(*(group or "" for group in found.groups())) for found in FENCE.finditer(page.read_text())]


def write_files(page: Path, folder: Path) -> None:
    """Write the files that a page shows."""
    for block in blocks_of(page):
        if block.file:
            (folder / block.file).parent.mkdir(parents=True, exist_ok=True)
            (folder / block.file).write_text(block.text)
