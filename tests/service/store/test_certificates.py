"""Certificates as they are stored and found again; the flights themselves are tested in tests/core."""

from datetime import timedelta

import pytest
from sqlalchemy import func, select

from service.db.tables import CertificateRow
from service.schemas.solution import Filter
from service.store.errors import UnknownRowError
from tests.api_examples import example_of
from tests.service.campaigns import finish, submitted
from tests.service.databases import needs_postgres
from workers.certificate import CertificateDocument

KINDS = ["sqlite", pytest.param("postgresql", marks=needs_postgres)]
EXAMPLE = example_of(CertificateDocument)


def document(solution_id, **content):
    changed = EXAMPLE.content.model_copy(update={"solution_id": solution_id} | content)
    return EXAMPLE.model_copy(update={"content": changed})


@pytest.fixture
def solution_id(store):
    submitted(store)
    finish(store, n_steps=6)
    return store.certificates.ids(Filter(strict=True))[0]


def n_rows(store):
    with store._database.read() as session:
        return session.scalar(select(func.count()).select_from(CertificateRow))


@pytest.mark.parametrize("store", KINDS, indirect=True)
def test_a_certificate_comes_back_as_it_was_stored(store, solution_id):
    assert store.certificates.latest(solution_id) is None
    assert store.certificates.add(document(solution_id), "here")
    assert store.certificates.latest(solution_id) == document(solution_id)


@pytest.mark.parametrize("store", KINDS, indirect=True)
def test_the_same_certificate_again_is_the_same_row_and_says_when(store, solution_id):
    first = document(solution_id)
    later = first.model_copy(
        update={"checked_at": first.checked_at + timedelta(days=1), "made_on": "elsewhere"}
    )
    assert store.certificates.add(first, "here") and not store.certificates.add(later, "here")
    found = store.certificates.latest(solution_id)
    assert found.checked_at == later.checked_at and found.made_at == first.made_at and n_rows(store) == 1


@pytest.mark.parametrize("store", KINDS, indirect=True)
def test_the_certificate_that_was_found_last_is_shown_and_the_others_are_kept(store, solution_id):
    old = document(solution_id)
    new = old.model_copy(update={"hash": "0" * 32, "checked_at": old.checked_at + timedelta(days=1)})
    store.certificates.add(new, "there")
    store.certificates.add(old, "here")
    assert store.certificates.latest(solution_id).hash == new.hash and n_rows(store) == 2


@pytest.mark.parametrize("store", KINDS, indirect=True)
def test_only_what_was_found_sound_at_its_level_on_the_same_basis_need_not_be_flown_again(store, solution_id):
    store.certificates.add(document(solution_id), "here")
    assert store.certificates.sound_on("here") == {solution_id} and not store.certificates.sound_on("there")
    worse = document(solution_id, level="paper")
    store.certificates.add(worse.model_copy(update={"hash": "1" * 32}), "paper")
    unsound = document(solution_id, is_sound=False)
    store.certificates.add(unsound.model_copy(update={"hash": "2" * 32}), "unsound")
    # Archived as strict, it is worse than it was.
    assert not store.certificates.sound_on("paper") and not store.certificates.sound_on("unsound")


def test_what_does_not_exist_has_no_certificate_and_no_subject(store):
    for ask in (store.certificates.latest, store.certificates.subject):
        with pytest.raises(UnknownRowError, match="solution abc: expected one that exists"):
            ask("abc")


def test_the_route_gives_the_certificate_or_says_how_to_make_one(client, store, solution_id):
    missing = client.get(f"/api/v1/solutions/{solution_id}/certificate")
    assert missing.status_code == 404
    assert f"make it with `coastarc solutions verify {solution_id[:8]}`" in missing.json()["detail"]
    store.certificates.add(document(solution_id), "here")
    body = client.get(f"/api/v1/solutions/{solution_id}/certificate").json()
    assert CertificateDocument.model_validate(body) == document(solution_id)
