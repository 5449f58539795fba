"""Layouts of Foxglove, RViz and PlotJuggler for the topics of a scene."""
