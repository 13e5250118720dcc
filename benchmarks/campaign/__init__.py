"""Random scenes against independent references: what ``./run bench campaign`` is made of.

``scenes`` draws a scene and writes it as a script; ``points`` states the interface laws at points;
``reference`` solves the scene without the kernel; ``measure`` compares; ``judge`` runs one scene from its
script to its verdict; ``pool`` keeps the processes in which scenes run.
"""
