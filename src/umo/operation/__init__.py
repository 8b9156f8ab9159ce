"""Operating a machine: recipes (`umo.operation.recipes`, `umo.operation.recipe_book`)."""
