"""A dataset folder onto the Hub: verified, in one commit, under a tag that never moves."""

from xden_builder.pipeline.publish.run import Pushed, push

__all__ = ["Pushed", "push"]
