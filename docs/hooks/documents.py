"""MkDocs hook: the repository's own documents as pages, and links that leave ``docs``.

Every Markdown file of this repository links to other files by relative paths, so that links work
wherever the repository is browsed. On the site, a link out of ``docs`` becomes: the page of a
document that the site includes, the reference page of a package or module, or a copy of the file.
"""

from __future__ import annotations

import logging
import os
import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

from docs.hooks.reference import page_of

ROOT = Path(__file__).parents[2]
DOCUMENTS = {
    "project/architecture.md": "ARCHITECTURE.md",
    "project/changelog.md": "CHANGELOG.md",
    "project/contributing.md": "CONTRIBUTING.md",
    "project/leaderboard.md": "LEADERBOARD.md",
    "project/readme.md": "README.md",
    "project/security.md": "SECURITY.md",
    "project/builder.md": "builder/README.md",
    "project/benchmarks.md": "benchmarks/README.md",
    "project/space.md": "benchmarks/space/README.md",
    "project/results.md": "benchmarks/results/README.md",
    "project/baselines.md": "baselines/README.md",
    "project/xden1k.md": "xden1k/README.md",
    "project/sample.md": "xden1k/sample/README.md",
}
"""Pages that are files elsewhere in the repository; one that does not exist is left out."""

LINK = re.compile(r"(?<!\\)(!?\[(?:[^\[\]]|\[[^\]]*\])*\])\(([^)\s]+)\)")
REFERENCE_LINK = re.compile(r"^(\[[^\]]+\]:) +(\S+)$")
FENCE = re.compile(r"^\s*(```+|~~~+)")
logger = logging.getLogger("mkdocs.hooks.documents")


def on_config(config: Any) -> Any:
    """Leave documents that are not there out of the navigation."""
    config.nav = _present(config.nav)
    return config


def _present(nav: Any) -> Any:
    if isinstance(nav, list):
        return [kept for item in nav if (kept := _present(item)) is not None]
    if isinstance(nav, dict):
        found = {title: _present(item) for title, item in nav.items()}
        return None if None in found.values() else found
    return None if nav in DOCUMENTS and not (ROOT / DOCUMENTS[nav]).is_file() else nav


def on_files(files: Files, config: Any) -> Files:
    """Add the documents, and a copy of each file that some page links to."""
    for uri, source in DOCUMENTS.items():
        if (ROOT / source).is_file():
            files.append(File.generated(config, uri, content=_text(ROOT / source)))
    for page in list(files.documentation_pages()):
        for target in _targets(page.content_string, origin(page.src_uri)):
            uri = f"files/{target}"
            if _is_copied(target) and not files.get_file_from_path(uri):
                path = str(ROOT / target)
                files.append(File.generated(config, uri, abs_src_path=path))
    return files


def _text(path: Path) -> str:
    """Return a document without the YAML header that others read."""
    text = path.read_text(encoding="utf-8")
    return text.split("\n---\n", 1)[1] if text.startswith("---\n") else text


def origin(uri: str) -> str:
    """Return where in the repository a page comes from."""
    return DOCUMENTS.get(uri, f"docs/{uri}")


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turn relative links of the repository into links of the site."""
    source = origin(page.file.src_uri)

    def replaced(found: re.Match[str]) -> str:
        words, link = found[1], found[2]
        target = _site_target(link, source)
        if target is None:
            return words if words.startswith("!") else words[1:-1]
        url = target if "://" in target or target.startswith("#") else _relative(target, page)
        return f"{words} {url}" if words.endswith(":") else f"{words}({url})"

    return "\n".join(
        line if is_code else REFERENCE_LINK.sub(replaced, LINK.sub(replaced, line))
        for line, is_code in _lines(markdown)
    )


def _relative(target: str, page: Any) -> str:
    return posixpath.relpath(target, posixpath.dirname(page.file.src_uri) or ".")


def _lines(markdown: str) -> list[tuple[str, bool]]:
    """Split into lines, each with whether it belongs to a block of code."""
    fence, lines = "", []
    for line in markdown.split("\n"):
        mark = FENCE.match(line)
        if fence:
            lines.append((line, True))
            fence = "" if mark and line.strip() == fence else fence
        else:
            fence = mark[1] if mark else ""
            lines.append((line, bool(mark)))
    return lines


def links(markdown: str) -> list[str]:
    """Return the targets of all links of a Markdown text, those in code left out."""
    found = []
    for line, is_code in _lines(markdown):
        if not is_code:
            bare = re.sub(r"(`+)(?:(?!\1).)*\1", lambda code: "`" * len(code[0]), line)
            found += [match[2] for match in LINK.finditer(bare)]
            found += [match[2] for match in REFERENCE_LINK.finditer(bare)]
    return found


def _targets(markdown: str, source: str) -> set[str]:
    """Return the files of the repository that a document links to."""
    outside = (link for link in links(markdown) if not re.match(r"[a-z]+:|#", link))
    return {_resolved(link, source) for link in outside}


def _resolved(link: str, source: str) -> str:
    path = link.partition("#")[0]
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), path))


def _is_copied(target: str) -> bool:
    """Whether the site holds a copy: a file that is neither in ``docs``, a page, nor code."""
    return (
        not target.startswith("docs/")
        and target not in DOCUMENTS.values()
        and page_of(target) is None
        and (ROOT / target).is_file()
    )


def _site_target(link: str, source: str) -> str | None:
    """Return what a link leads to on the site; None if it has no place there."""
    if re.match(r"[a-z]+:|#", link):
        return link
    target, anchor = _resolved(link, source), link[link.index("#") :] if "#" in link else ""
    for uri, document in DOCUMENTS.items():
        if document == target:
            return uri + anchor
    if target.startswith("docs/"):
        return target.removeprefix("docs/") + anchor
    if (page := page_of(target)) is not None:
        return page
    if _is_copied(target):
        return f"files/{target}"
    if not os.path.exists(ROOT / target):
        logger.warning("%s links to %s, which does not exist", source, link)
    return None
