"""The whole portrait in one HTML file that anybody can open, and any panel can show.

`write_page` writes it: `packing` makes a few megabytes of the field, as fine as the size that is
asked for allows, `assembly` joins all with the page's script in `web/` and a picture that shows at
once. `serve_page` shows it in a browser. See docs/portrait-page.md for what the page does.
`recolored` gives a page that is open other colors.
"""
