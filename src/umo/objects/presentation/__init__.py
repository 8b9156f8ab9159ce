"""Values and runs as text and HTML. The forms are the same in the terminal, the notebook, the page and files."""
