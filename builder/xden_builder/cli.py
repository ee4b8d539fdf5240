"""``xden-build``: simulate captures, rebuild them, audit and publish the result."""

from __future__ import annotations

import logging

import click

from xden1k.commands import Group
from xden_builder.commands.align import align
from xden_builder.commands.audit import audit
from xden_builder.commands.bench_scanner import bench_scanner
from xden_builder.commands.calibrate import calibrate
from xden_builder.commands.check import check
from xden_builder.commands.datasheet import datasheet
from xden_builder.commands.evaluate import evaluate
from xden_builder.commands.import_release import import_release
from xden_builder.commands.init import init
from xden_builder.commands.mend import mend
from xden_builder.commands.partnext import partnext
from xden_builder.commands.phantoms import gallery, phantoms
from xden_builder.commands.push import push
from xden_builder.commands.report import report
from xden_builder.commands.run import run
from xden_builder.commands.speed import speed
from xden_builder.commands.twin import twin

__all__ = ["cli"]


@click.group(cls=Group)
@click.version_option(package_name="xden1k", prog_name="xden-build")
def cli() -> None:
    """Rebuild density from radiographs and part meshes; simulate captures to try it on."""
    logging.basicConfig(format="%(levelname)s: %(message)s")


_COMMANDS = (
    *(init, calibrate, check, mend, phantoms, partnext, align, run, import_release, report, audit),
    *(datasheet, push, evaluate, bench_scanner, gallery, twin, speed),
)
for _command in _COMMANDS:
    cli.add_command(_command)
