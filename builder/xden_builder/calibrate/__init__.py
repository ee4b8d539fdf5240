"""A scanner by its own radiographs of step wedges and balls: spectrum, stray light, geometry.

Reading order: ``designs`` (the phantoms), ``told`` (``calibration.toml``), ``readings`` (the steps
in an image), ``light`` (the model of a reading), ``spectrum`` (its fit), ``balls`` (their centres),
``geometry`` (the bundle adjustment), ``figures``, ``run``; ``example`` simulates a folder.
"""
