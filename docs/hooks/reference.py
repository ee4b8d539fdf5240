"""MkDocs hook: the reference, from the packages as they are.

A package of the repository has a page for its own names, one for each of its sub-packages and one
for each of its modules. Modules are found by reading the files, never by importing them, so that
moving one needs no edit here. What is public is what ``__all__`` names.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mkdocs.structure.files import File, Files

from docs.hooks.docstrings import as_markdown

if TYPE_CHECKING:
    import click

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "xden1k": "xden1k",
    "xden_builder": "builder/xden_builder",
    "xden_bench": "benchmarks/xden_bench",
    "xden_baselines": "baselines/xden_baselines",
}
"""Import name of each package, and its folder."""
INDEX = "reference/index.md"


@dataclass(frozen=True)
class Module:
    """One module as its file shows it.

    Parameters
    ----------
    name
        As it is imported.
    path
        Relative to the repository.
    public
        Names in its ``__all__``.
    imported
        For each public name that another module of ours defines, that module.
    summary
        First line of its docstring.
    """

    name: str
    path: Path
    public: tuple[str, ...]
    imported: dict[str, str]
    summary: str

    @property
    def is_package(self) -> bool:
        """Whether it is the ``__init__`` of a package."""
        return self.path.name == "__init__.py"


def modules(package: str) -> list[Module]:
    """Return all modules of a package, each package before its modules."""
    folder = ROOT / PACKAGES[package]
    found = []
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        if parts[-1] == "__main__":
            continue
        name = ".".join((package, *(part for part in parts if part != "__init__")))
        found.append(_module(name, path))
    return sorted(found, key=lambda module: module.name.split("."))


def _module(name: str, path: Path) -> Module:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    public: tuple[str, ...] = ()
    imported = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            imported |= {alias.asname or alias.name: node.module for alias in node.names}
        if isinstance(node, ast.Assign) and [ast.unparse(t) for t in node.targets] == ["__all__"]:
            public = tuple(ast.literal_eval(node.value))
    text = ast.get_docstring(tree) or ""
    return Module(
        name=name,
        path=path.relative_to(ROOT),
        public=public,
        imported={each: imported[each] for each in public if each in imported},
        summary=" ".join(text.split("\n\n")[0].split()),
    )


def pages(package: str) -> dict[str, list[Module]]:
    """Return what each page of a package holds: its modules, by the page's address."""
    found: dict[str, list[Module]] = {}
    for module in modules(package):
        found.setdefault(_page(module.name), []).append(module)
    return found


def _page(name: str) -> str:
    package, _, rest = name.partition(".")
    return f"reference/{package}/{rest.split('.')[0] or 'index'}.md"


def page_of(path: str) -> str | None:
    """Return the reference page of a folder or file of code; None if it is no module of ours."""
    for package, folder in PACKAGES.items():
        inside = Path(path)
        if not inside.is_relative_to(folder) or inside.suffix not in ("", ".py"):
            continue
        parts = inside.relative_to(folder).with_suffix("").parts
        name = ".".join(
            (package, *(part for part in parts if part not in ("__init__", "__main__")))
        )
        if (ROOT / path).is_file():
            return _page(name) if inside.stem == "__main__" else f"{_page(name)}#{name}"
        if (ROOT / path / "__init__.py").is_file():
            return f"{_page(name)}#{name}"
    return None


def on_config(config: Any) -> Any:
    """Put every page of the reference into the navigation."""
    for section in config.nav:
        if INDEX in section.values():
            section["Reference"] = [
                INDEX,
                "reference/commands.md",
                *({package: list(pages(package))} for package in PACKAGES),
            ]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Write the pages."""
    for package in PACKAGES:
        for uri, held in pages(package).items():
            files.append(File.generated(config, uri, content="\n".join(_content(uri, held))))
    files.append(File.generated(config, "reference/commands.md", content=commands_page()))
    return files


def _content(uri: str, held: list[Module]) -> Iterator[str]:
    """Write one page; its first module, a package or the only one, gives the title."""
    yield f"---\ntitle: {held[0].name.split('.', 1)[-1]}\n---\n"
    for number, module in enumerate(held):
        yield f"{'#' if number == 0 else '##'} `{module.name}` {{ #{module.name} }}\n"
        own = [name for name in module.public if name not in module.imported]
        if module.is_package and module.imported:
            yield _described(module, [])
            yield "\n".join(_exports(module)) + "\n"
            if own and own != ["__version__"]:
                yield _described(module, own, docstring=False)
        else:
            yield _described(module, own)


def _described(module: Module, names: list[str], docstring: bool = True) -> str:
    level = 2 if not names else 3
    options = {
        "members": names or "false",
        "show_root_toc_entry": "false",
        "show_root_heading": "false",
        "heading_level": level,
        "show_docstring_description": "true" if docstring else "false",
    }
    lines = [f"::: {module.name}", "    options:"]
    lines += [f"      {key}: {value}" for key, value in options.items()]
    return "\n".join(lines) + "\n"


def _exports(module: Module) -> Iterator[str]:
    """Write a table of what a package gives on from its modules."""
    yield "| from here | what it is |"
    yield "| --- | --- |"
    for name, source in sorted(module.imported.items()):
        home, words = _definition(source, name)
        yield f"| [`{name}`][{home}.{name}] | {as_markdown(words).replace('|', '&#124;')} |"


def _definition(module: str, name: str) -> tuple[str, str]:
    """Return the module that defines a name, and what its docstring begins with."""
    package, *parts = module.split(".")
    place = (ROOT / PACKAGES[package]).joinpath(*parts)
    path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    if source := _module(module, path).imported.get(name):
        return _definition(source, name)
    body = ast.parse(path.read_text(encoding="utf-8")).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        text = ""
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == name:
            text = ast.get_docstring(node) or ""
        elif name in _assigned(node) and isinstance(after, ast.Expr):
            text = str(ast.literal_eval(after.value))  # a constant's stands below it
        if text:
            return module, " ".join(text.split("\n\n")[0].split())
    return module, ""


def _assigned(node: ast.stmt) -> list[str]:
    targets = getattr(node, "targets", [getattr(node, "target", None)])
    return [target.id for target in targets if isinstance(target, ast.Name)]


def commands_page() -> str:
    """Write what ``--help`` of each command says, those that packages add to ``xden`` as well."""
    import click

    from xden1k.cli import cli as xden
    from xden_bench.cli import cli as xden_bench
    from xden_builder.cli import cli as xden_build

    lines = ["# Commands", "", "What `--help` says of each command.", ""]
    for program, group in (("xden", xden), ("xden-build", xden_build), ("xden-bench", xden_bench)):
        lines += [f"## `{program}`", "", str(group.help), ""]
        top = click.Context(group, info_name=program)
        for name in group.list_commands(top):
            text = _help(group, name, top)
            lines += [f"### `{program} {name}`", "", "```text", text, "```", ""]
    return "\n".join(lines)


def _help(group: click.Group, name: str, top: click.Context) -> str:
    """Return the help of a command, which may be loaded only when its context is made."""
    command = group.get_command(top, name)
    assert command is not None  # the group lists it
    context = command.make_context(name, [], parent=top, resilient_parsing=True)
    context.max_content_width = context.terminal_width = 88
    return context.command.get_help(context)
