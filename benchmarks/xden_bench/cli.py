"""``xden-bench``: check, score and enter submissions; run baselines; make the leaderboard."""

from __future__ import annotations

import click

from xden1k.commands import Group
from xden_bench.commands.appearance import appearance
from xden_bench.commands.arm import arm
from xden_bench.commands.board import leaderboard
from xden_bench.commands.coverage import coverage
from xden_bench.commands.dataset import dataset
from xden_bench.commands.disturb import disturb
from xden_bench.commands.entries import compare, verify, withdraw
from xden_bench.commands.manip import manip
from xden_bench.commands.mechanics import mechanics
from xden_bench.commands.methods import baseline
from xden_bench.commands.sealing import keygen, seal, verify_sealed
from xden_bench.commands.segments import segment
from xden_bench.commands.slip import slip
from xden_bench.commands.speed import speed
from xden_bench.commands.submissions import score, submit, template, validate
from xden_bench.commands.verify_picks import verify as verify_picks
from xden_bench.commands.web import serve

__all__ = ["cli"]


@click.group(cls=Group)
@click.version_option(package_name="xden1k", prog_name="xden-bench")
def cli() -> None:
    """Check, score and enter submissions; run baselines; make the leaderboard."""


cli.add_command(template)
cli.add_command(validate)
cli.add_command(score)
cli.add_command(submit)
cli.add_command(leaderboard)
cli.add_command(compare)
cli.add_command(appearance)
cli.add_command(verify)
cli.add_command(withdraw)
cli.add_command(coverage)
cli.add_command(baseline)
cli.add_command(dataset)
manip.add_command(arm)
cli.add_command(disturb)
manip.add_command(mechanics)
manip.add_command(slip)
manip.add_command(verify_picks)
cli.add_command(manip)
cli.add_command(segment)
cli.add_command(speed)
cli.add_command(keygen)
cli.add_command(seal)
cli.add_command(verify_sealed)
cli.add_command(serve)
