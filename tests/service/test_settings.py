from pathlib import Path

import pytest

from service.settings import Settings, SettingsError, variable_of

SECURITY = (Path(__file__).parents[2] / "docs" / "security.md").read_text(encoding="utf-8")


def test_settings_come_from_the_environment_and_empty_ones_count_as_absent():
    settings = Settings.from_environment(
        {"COASTARC_AUTH": "required", "COASTARC_HOSTS": "a.example, b.example", "COASTARC_PROXIES": ""}
    )
    assert settings.auth == "required" and settings.hosts == ("a.example", "b.example")
    assert settings.proxies == ()


def test_a_secret_is_read_from_a_file_and_never_shown(tmp_path):
    path = tmp_path / "token"
    path.write_text("coastarc_secret\n")
    settings = Settings.from_environment({"COASTARC_TOKEN_FILE": str(path)})
    assert settings.token.get_secret_value() == "coastarc_secret"
    assert "coastarc_secret" not in f"{settings!r} {settings} {settings.model_dump_json()}"


@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({"COASTARC_AUTH": "requird"}, "COASTARC_AUTH: expected 'auto' or 'required', got 'requird'"),
        ({"COASTARC_REQUEST_BURST": "0"}, "COASTARC_REQUEST_BURST: expected a number of at least 1"),
        ({"COASTARC_REQUESTS_PER_SECOND": "nan"}, "COASTARC_REQUESTS_PER_SECOND: expected"),
        ({"COASTARC_PROXIES": "proxy"}, "COASTARC_PROXIES"),
        (
            {"COASTARC_TOKEN": "a", "COASTARC_TOKEN_FILE": "b"},
            "expected itself or COASTARC_TOKEN_FILE, got both",
        ),
        ({"COASTARC_TOKEN_FILE": "/nowhere/token"}, "expected a file to read, got /nowhere/token"),
    ],
)
def test_a_variable_that_means_nothing_is_refused_by_name(variables, message):
    with pytest.raises(SettingsError, match=message):
        Settings.from_environment(variables)


def test_an_empty_secret_file_is_refused(tmp_path):
    (tmp_path / "token").write_text("\n")
    with pytest.raises(SettingsError, match="which is empty"):
        Settings.from_environment({"COASTARC_TOKEN_FILE": str(tmp_path / "token")})


@pytest.mark.parametrize("field", Settings.model_fields)
def test_every_setting_is_documented(field):
    assert f"`{variable_of(field)}`" in SECURITY
