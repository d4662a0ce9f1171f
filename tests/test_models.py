"""The registry of pretrained weights."""

import hashlib

import pytest

from lfportrait import models
from lfportrait.errors import UserError
from lfportrait.models import ModelFile


@pytest.fixture
def shelf(tmp_path, monkeypatch):
    """An empty cache, an empty named folder, and a registry with one tiny network."""
    named, cache = tmp_path / "named", tmp_path / "cache"
    named.mkdir()
    content = b"weights"
    digest = hashlib.sha256(content).hexdigest()
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(named))
    monkeypatch.delenv("LFPORTRAIT_MIRROR", raising=False)
    monkeypatch.setattr(models, "cache_folder", lambda: cache)
    monkeypatch.setattr(models, "REGISTRY", {
        "tiny": (ModelFile("tiny.safetensors", digest, "a test", "CC0"),),
        "remote": (ModelFile("remote.bin", digest, "a test", "CC0",
                             "http://127.0.0.1:9/remote.bin"),)})
    return named, cache, content


def test_the_named_folder_comes_before_the_cache(shelf):
    named, cache, content = shelf
    assert not models.available("tiny")
    cache.mkdir()
    (cache / "tiny.safetensors").write_bytes(content)
    assert models.fetch("tiny") == cache / "tiny.safetensors"
    (named / "tiny.safetensors").write_bytes(content)
    assert models.fetch("tiny") == named / "tiny.safetensors"
    assert models.available("tiny")


def test_a_missing_network_is_told_with_all_one_needs(shelf):
    with pytest.raises(UserError, match=r"tiny\.safetensors.*CC0.*LFPORTRAIT_MODELS"):
        models.fetch("tiny")
    with pytest.raises(UserError, match="there is no network"):
        models.fetch("huge")


def test_files_are_added_by_their_hash(shelf, tmp_path):
    _, cache, content = shelf
    (tmp_path / "any name").write_bytes(content)
    assert models.add(tmp_path / "any name") == cache / "tiny.safetensors"
    assert models.available("tiny")
    (tmp_path / "other").write_bytes(b"else")
    with pytest.raises(UserError, match="matches no entry"):
        models.add(tmp_path / "other")
    with pytest.raises(UserError, match="no such file"):
        models.add(tmp_path / "nothing")


def test_the_listing_tells_what_is_here(shelf):
    _, cache, content = shelf
    assert all("missing" in row for row in models.listing())
    cache.mkdir()
    (cache / "tiny.safetensors").write_bytes(content)
    here, remote = models.listing()
    assert "here" in here and here.endswith("by hand, optional")
    assert "missing" in remote and remote.endswith("http://127.0.0.1:9/remote.bin")


def test_every_entry_is_complete():
    for name, entries in models.REGISTRY.items():
        for entry in entries:
            assert entry.file, name
            assert entry.source, name
            assert entry.licence, name
            assert len(entry.sha256) in (8, 64), name
            assert int(entry.sha256, 16) >= 0
            assert not entry.url or entry.url.startswith("https://")
            assert entry.size > 0, name


def test_every_network_of_a_group_has_an_official_address():
    registry = models.REGISTRY
    for group, names in models.GROUPS.items():
        assert group not in registry
        for name in names:
            assert any(entry.url for entry in registry[name]), name
    portrait = [entry for name in models.GROUPS["portrait"] for entry in registry[name]]
    assert all(entry.url and len(entry.sha256) == 64 for entry in portrait)
    assert sum(entry.size for entry in portrait) < 6e6


@pytest.mark.data
def test_the_weights_at_hand_match_their_hashes(shared_weights):
    entries = [entry for network in models.REGISTRY.values() for entry in network]
    files = {entry.file for entry in entries if (shared_weights / entry.file).is_file()}
    assert len(files) >= 8
    for file in files:
        assert any(models._matches(shared_weights / file, entry)
                   and entry.size == (shared_weights / file).stat().st_size
                   for entry in entries if entry.file == file), file


def test_a_damaged_file_is_refused_until_it_is_mended(shelf):
    named, _, content = shelf
    (named / "tiny.safetensors").write_bytes(content[:-1])
    with pytest.raises(UserError, match=r"tiny\.safetensors.*SHA-256"):
        models.fetch("tiny")
    (named / "tiny.safetensors").write_bytes(content)
    assert models.fetch("tiny").read_bytes() == content


def test_any_file_of_a_network_will_do(shelf, monkeypatch):
    named, _, content = shelf
    digest = hashlib.sha256(content).hexdigest()
    monkeypatch.setitem(models.REGISTRY, "tiny", (
        ModelFile("tiny.safetensors", "0" * 64, "a test", "CC0"),
        ModelFile("tiny.safetensors", digest, "a later test", "CC0"),
        ModelFile("tiny.pth", digest[:8], "a firm", "CC0")))
    (named / "tiny.pth").write_bytes(content)
    assert models.fetch("tiny") == named / "tiny.pth"
    (named / "tiny.safetensors").write_bytes(content)  # the second hash for this name
    assert models.fetch("tiny") == named / "tiny.safetensors"


@pytest.mark.data
def test_the_networks_at_hand_pass_the_check(shared_weights, monkeypatch):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(shared_weights))
    for name in models.REGISTRY:
        if models.available(name):
            # A head lies in a collection of its own beside the networks.
            folder = models.fetch(name, download=False).parent
            assert folder in (shared_weights, shared_weights.parent / "head_prior")
    assert set(models.expand(["portrait", "paper", "inception"])) <= {
        name for name in models.REGISTRY if models.available(name)}


def test_an_offline_process_downloads_nothing(monkeypatch, tmp_path):
    monkeypatch.setenv("LFPORTRAIT_MODELS", str(tmp_path))
    monkeypatch.setattr(models, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(models, "fetch_file", lambda *_, **__: pytest.fail("it was asked for"))
    monkeypatch.setenv(models.OFFLINE, "1")
    with pytest.raises(UserError, match=r"face-landmarker.*missing"):
        models.fetch("face-landmarker")
