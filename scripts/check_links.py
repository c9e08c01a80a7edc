"""Whether the links and pictures of Markdown files outside of `docs/` lead to something.

    python scripts/check_links.py README.md CONTRIBUTING.md

A relative link has to name a file, and after `#` a heading of it. Pages of `docs/` are checked by `mkdocs build --strict`.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from markdown.extensions.toc import slugify

LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.*?)(?: *\{ *#([\w-]+) *\})?$", re.M)


def anchors(text: str) -> set[str]:
    """The anchors of a page's headings, as mkdocs makes them."""
    return {given or slugify(re.sub(r"[`*]", "", title), "-") for title, given in HEADING.findall(text)}


def broken(page: Path) -> list[str]:
    """One line for each link of a page that leads nowhere."""
    problems = []
    text = page.read_text()
    for target in LINK.findall(text):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        if not file.is_file():
            problems.append(f"{page}: {target}: no such file; mend the link")
        elif anchor and anchor not in anchors(file.read_text()):
            problems.append(f"{page}: {target}: no such heading; mend the link")
    return problems


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", type=Path, nargs="+")
    given = parser.parse_args()
    problems = [problem for page in given.pages for problem in broken(page)]
    if problems:
        raise SystemExit("\n".join(problems))
    print(f"{len(given.pages)} pages outside of docs/: no broken link")


if __name__ == "__main__":
    main()
