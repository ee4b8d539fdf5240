"""What pictures tell without outside weights: a network that names the material of every pixel.

``lessons`` are the pictures it learns from, ``network`` the network, ``training`` its loop;
``inference`` its answers; ``matter`` says what lies at which depth behind a material,
``predictor`` puts them together. ``seen`` is the perfect eye, which is told the materials.
"""
