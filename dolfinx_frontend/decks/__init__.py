"""Decks: assemblies described by a file, in TOML or in the format of another program.

>>> deck = read_deck("joint.toml")
>>> result = solve(assemble(deck.scene))
"""
