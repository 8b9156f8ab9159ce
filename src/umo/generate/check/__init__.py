"""Analyses and simplifies the form: effects, ways out of statements, and code without effect."""
