"""Contact: what touches and may part, from the words of a scene to the motion.

scene      what a scene may say: contacts, strings, their surfaces
geometry   gap, normal and point of a pair of surfaces, with their rates
friction   the law of traction
compile    a scene with contacts as a system
system     that system: layout, terms of the equations, laws, levels of its events
events     motion cut into pieces at events: impacts, and which contacts open, slip or stick
problem, solvers   one friction problem and what solves it
stepping   motion in fixed steps that impacts lie within
"""
