"""HTML, checked for being well formed."""

import re
from html.parser import HTMLParser

VOID = {"meta", "link", "br", "img", "hr", "input", "source"}


class Checker(HTMLParser):
    """Requires balanced tags, and collects ids, addresses and text."""

    def __init__(self):
        super().__init__()
        self.open_tags, self.ids, self.addresses, self.text = [], [], [], []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if "id" in attributes:
            self.ids.append(attributes["id"])
        self.addresses += [attributes[name] for name in ("src", "href") if name in attributes]
        if tag not in VOID:
            self.open_tags.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open_tags.pop()

    def handle_endtag(self, tag):
        assert self.open_tags.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def require_well_formed(html):
    """Require balanced tags, ids that differ, links to ids that exist, and no address outside the
    page; returns what was read.
    """
    checker = Checker()
    checker.feed(html)
    assert not checker.open_tags
    assert len(set(checker.ids)) == len(checker.ids)
    targets = {a[1:] for a in checker.addresses if a.startswith("#")}
    assert targets <= set(checker.ids)
    assert not [a for a in checker.addresses if re.match(r"(https?:)?//", a)]
    return checker
