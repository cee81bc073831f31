"""The directive `{made}`: Markdown that a function makes when the site is built, so no page repeats what code says."""

from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from website import content


class Made(SphinxDirective):
    """Put what a function of `website.content` returns into the page: its name, then its arguments."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list:
        """Parse the Markdown where the directive stands."""
        name, *given = self.arguments[0].split()
        self.env.note_reread()
        return self.parse_text_to_nodes(content.MADE[name](*given), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("made", Made)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
