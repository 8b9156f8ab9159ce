"""Values and runs as text and HTML, the same in the terminal, the notebook, the page and in files."""
