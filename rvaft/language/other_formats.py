"""Trees in the formats of other tools, by the root element of their XML documents."""

from rvaft.language.adtool import ROOTS, read_attack_tree
from rvaft.language.builder import Page
from rvaft.language.markup import read_document
from rvaft.language.open_psa import ROOT, read_model


def read_other_format(text: str, page: Page) -> None:
    """Add the tree of an XML document to a page; raises `LanguageError`, which quotes trees only."""
    root = read_document(text, page.file)
    if root.name == ROOT:
        read_model(root, page)
    elif root.name in ROOTS:
        read_attack_tree(root, page)
    else:
        known = f"{ROOT} (Open-PSA), {' or '.join(ROOTS)} (ADTool)"
        raise root.error(f"this XML document is no tree that rvaft reads: its root element is none of {known}")
