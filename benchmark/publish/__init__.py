"""How results become a folder: tables, figures, texts, manifest, and the page."""
