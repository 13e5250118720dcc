"""Abaqus and CalculiX decks (``.inp``): cards -> model -> pieces -> scene, and back.

========================  ==========================================================================
:mod:`.cards`             keyword blocks with their lines; nothing is understood
:mod:`.keywords`          what is represented, changed, ignored, refused
:mod:`.elements`          element types, their nodes and faces
:mod:`.axes`              local axes, rectangular and along cylinders
:mod:`.generated`         nodes and elements that are generated
:mod:`.model`             nodes, elements, sets, surfaces, materials, instances
:mod:`.history`           steps and amplitudes: every load as a curve in time
:mod:`.pieces`            meshes of one kind and material, cut at pre-tension sections
:mod:`.faces`             named faces
:mod:`.links`             equations, springs, nodes that follow others
:mod:`.interfaces`        contact pairs, ties, pre-tension sections, rigid bodies
:mod:`.loads`             supports, forces, pressures, temperatures
:mod:`.deck`              :func:`read_inp`
:mod:`.meshed`            a part as a deck has it
:mod:`.writing`           :func:`write_inp`
========================  ==========================================================================
"""
