"""Contacts in motion: what happens to bodies that touch, by events or by time stepping.

events         motion cut into pieces at events: impacts, and which contacts open, slip or stick
problem        the contact problem at one instant, which events ask
stepping       motion in fixed steps that impacts lie within
solvers        solvers of the friction problem of a step
tunnelling     checks of sides that sink into a support between samples
choose_motion  which motion a compiled scene has: smooth, cut at events, or stepped

What a scene may say of contacts, and their geometry, is in `catalogue`; the system of bodies in
contact, its laws and event functions, in `mechanics.contact`.
"""
