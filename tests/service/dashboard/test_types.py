from tests.page_types import TYPES, first_line


def test_the_types_of_the_page_are_those_of_the_api():
    with TYPES.open(encoding="utf-8") as types:
        assert types.readline() == first_line(), "the API has other shapes; run make types"
