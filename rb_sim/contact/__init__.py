# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

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
