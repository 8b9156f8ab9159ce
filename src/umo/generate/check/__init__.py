"""Analyses and simplifies the form. It finds effects and ways out of statements, and removes code without effect."""
