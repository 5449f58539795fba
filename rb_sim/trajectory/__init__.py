"""The record of a run, and what can be made of it: tables, plots, wrenches, single states."""
