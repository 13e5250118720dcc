"""Bulk data of Nastran.

========================  ==========================================================================
:mod:`.bulk`              cards with their fields and lines; nothing is understood
:mod:`.case`              subcases, and the sets that they name
:mod:`.translated`        cards as those of the model that decks share
:mod:`.deck`              :func:`read_bdf`
========================  ==========================================================================
"""
