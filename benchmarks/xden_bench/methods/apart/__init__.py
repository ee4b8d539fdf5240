"""A method in a process of its own, which is shown what the method declared and nothing else.

The process gets no dataset and no path to one. It asks for what it needs, one attribute of one
object at a time, and this process answers within what was declared: :mod:`.answers` holds the
rules, :mod:`.asked` what the method sees in place of a sample, :mod:`.process` runs it.

This keeps a method from reading an answer by the objects it is handed, by whatever else lies in its
memory, or by its environment. It does not keep it from the disk, the network, or the process that
started it, which run under the same user: what a method does there is a matter of honour and of
reading its code. Its module is imported on both sides, and a source of pictures that it brings is
called on this one.
"""

from xden_bench.methods.apart.runner import Method, run_apart

__all__ = ["Method", "run_apart"]
