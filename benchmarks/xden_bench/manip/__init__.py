"""What a centre of mass is worth to a gripper: picks of the dataset's objects, in simulation.

``protocol`` has the numbers; ``draws`` what chance decides; ``closed_forms`` what mechanics says
without a simulator; ``statistics`` how sure a share of successes is. ``shape`` is an object's outer
surface, ``hulls`` what is felt of it (files of ``arrays``); ``grasps`` are candidates, of the
``sampler`` or of other detectors (``graspnet``), that have ``clearance``; ``pose`` moves them.
In MuJoCo, ``scene`` builds table, object and gripper, ``rest`` drops the object, ``trial`` picks,
and gives an ``outcome``. What is ``standing`` on its ``support`` is placed and pushed, and
``mechanics`` compares that with statics, by the numbers of ``mechanics_protocol``. ``arm`` is the
user's own model of one, and ``torques`` are what it bears, by the numbers of ``arm_protocol``.

``preparing`` chooses objects and makes each an ``item``, ``scenes`` freezes them. ``choosing``
says which candidate a row takes, ``running`` tries it, ``row_files`` are written and ``rows`` read,
``table`` compares them with each other and ``slipping`` with statics; ``section`` is for the
leaderboard, ``pictures`` and ``figure`` draw.
"""
