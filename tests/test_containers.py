"""The image and the compose file agree with the code: commands, extras, ports, paths, settings, secrets."""

import json
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import typer
import yaml

from service.auth.rights import ANYONE, RIGHTS
from service.cli import app_of
from service.cli.options import DEFAULT_PORT
from service.db.engine import URL_VARIABLE, database_url
from service.settings import PREFIX, Settings

ROOT = Path(__file__).parents[1]
DOCKERFILE = (ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8")
# Every line of an instruction in one.
LINES = re.sub(r"\\\n\s*", "", re.sub(r"^#.*\n", "", DOCKERFILE, flags=re.MULTILINE)).splitlines()
COMPOSE = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8"))
SERVICES = COMPOSE["services"]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DEPLOY = (ROOT / "docs" / "deploy.md").read_text(encoding="utf-8").partition("## Containers")[2]


def instructions(name):
    return [line.removeprefix(name).strip() for line in LINES if line.startswith(f"{name} ")]


def words_of(command):
    """Return the commands of a service, each in words; a shell runs several."""
    if command[:2] == ["sh", "-ec"]:
        lines = re.sub(r"\\\n\s*", "", command[2]).strip().splitlines()
        return [shlex.split(line.removeprefix("exec ")) for line in lines]
    return [command]


COMMANDS = [json.loads(instructions("CMD")[-1])] + [
    words for service in SERVICES.values() for words in words_of(service.get("command", []))
]
OURS = [words[1:] for words in COMMANDS if words[:1] == ["coastarc"]]
RAYS = [words[1:] for words in COMMANDS if words[:1] == ["ray"]]


def test_every_role_has_a_command():
    assert len(OURS) == 5 and len(RAYS) == 3 and [] in COMMANDS  # The database has its image's own.
    assert {words[0] for words in OURS} == {"serve", "dispatch"}


@pytest.mark.parametrize("words", OURS, ids=" ".join)
def test_a_command_of_ours_is_understood_to_its_last_word(words):
    command = typer.main.get_command(app_of()).commands[words[0]]
    context = command.make_context(words[0], list(words[1:]))
    assert not context.args


def test_the_commands_of_ray_have_options_that_ray_has():
    code = "from ray.scripts.scripts import cli; cli()"
    told = subprocess.run([sys.executable, "-c", code, "start", "--help"], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    for words in RAYS:
        assert words[0] == "start"
        assert {word.partition("=")[0] for word in words[1:]} <= set(re.findall(r"--[\w-]+", told.stdout))


def test_the_image_installs_extras_that_exist_from_pinned_versions():
    (install,) = [line for line in instructions("RUN") if "pip install" in line]
    (extras,) = re.findall(r"'\.\[([\w,]+)\]'", install)
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    assert "-c constraints.txt" in install and {"postgres", "ray"} == set(extras.split(","))


def test_what_the_image_copies_is_there_and_no_secret_is_among_it():
    copied = {word for line in instructions("COPY") if "--from" not in line for word in line.split()[:-1]}
    assert all((ROOT / name).exists() for name in copied)
    allowed = (ROOT / "docker" / "Dockerfile.dockerignore").read_text(encoding="utf-8").splitlines()
    assert "*" in allowed and {line[1:] for line in allowed if line.startswith("!")} == copied


def test_the_image_has_a_python_that_the_project_takes_and_is_the_same_in_both_stages():
    versions = {re.match(r"python:(\d+\.\d+)-", line).group(1) for line in instructions("FROM")}
    assert versions == {PROJECT["requires-python"].removeprefix(">=").partition(",")[0]}


def test_the_image_runs_as_nobody_in_particular_and_asks_whether_it_lives():
    assert instructions("USER") == ["10001:10001"]
    assert instructions("EXPOSE") == [str(DEFAULT_PORT)]
    (check,) = instructions("HEALTHCHECK")
    (path,) = re.findall(rf"http://127\.0\.0\.1:{DEFAULT_PORT}(/\w+)", check)
    assert RIGHTS[f"GET {path}"] == ANYONE


def test_the_health_check_is_for_coordinators_alone():
    for name, service in SERVICES.items():
        is_coordinator = "serve" in service.get("command", [])
        assert name == "database" or ("healthcheck" in service) is not is_coordinator
        assert name == "database" or is_coordinator or service["healthcheck"] == {"disable": True}


def test_nothing_is_published_but_the_page_and_that_to_this_machine_alone():
    published = [port for service in SERVICES.values() for port in service.get("ports", [])]
    assert set(published) == {f"127.0.0.1:{DEFAULT_PORT}:{DEFAULT_PORT}"}
    assert all("network_mode" not in service for service in SERVICES.values())
    outside = {name for name, service in SERVICES.items() if "outside" in service["networks"]}
    assert outside == {"coordinator", "coordinator-postgres"} and COMPOSE["networks"]["inside"]["internal"]


def test_a_coordinator_leaves_the_work_to_others_and_knows_the_name_they_call_it():
    urls = {words[words.index("--url") + 1] for words in OURS if "--url" in words}
    assert urls == {f"http://coordinator:{DEFAULT_PORT}"}
    for name in ("coordinator", "coordinator-postgres"):
        service = SERVICES[name]
        assert service["command"][-2:] == ["--workers", "0"]
        assert service["environment"]["COASTARC_HOSTS"] == "coordinator"
        assert service["networks"]["inside"]["aliases"] == ["coordinator"]


def test_every_setting_is_one_and_every_secret_comes_as_a_file_that_is_mounted():
    known = {PREFIX + field.upper() for field in Settings.model_fields} | {f"{PREFIX}TOKEN_FILE"}
    known |= {f"{URL_VARIABLE}_FILE", f"{PREFIX}DATA"}
    image = re.findall(rf"({PREFIX}\w+)=", " ".join(instructions("ENV")))
    assert image and set(image) <= known
    for service in SERVICES.values():
        for name, value in service.get("environment", {}).items():
            assert not name.startswith(PREFIX) or name in known
            assert "PASSWORD" not in name or name.endswith("_FILE")
            if name.endswith("_FILE"):
                assert value.removeprefix("/run/secrets/") in service["secrets"]
        assert set(service.get("secrets", [])) <= set(COMPOSE["secrets"])


def test_a_unit_of_systemd_keeps_what_is_compiled_where_it_may_write():
    page = (ROOT / "docs" / "deploy.md").read_text(encoding="utf-8")
    unit = page.partition("```ini")[2].partition("```")[0]
    assert "CacheDirectory=coastarc" in unit and "XDG_CACHE_HOME=/var/cache/coastarc" in unit


def test_roles_of_ray_have_its_token_and_the_image_asks_for_it():
    (environment,) = instructions("ENV")
    assert (
        "RAY_AUTH_MODE=token" in environment and "RAY_AUTH_TOKEN_PATH=/run/secrets/ray_token" in environment
    )
    for service in SERVICES.values():
        has_ray = any(words[0] == "ray" for words in words_of(service.get("command", [])) if words)
        assert has_ray is ("ray_token" in service.get("secrets", []))


def test_what_a_role_writes_goes_where_the_image_lets_its_user_write():
    (environment,) = instructions("ENV")
    assert "COASTARC_DATA=/var/lib/coastarc" in environment
    assert "XDG_CACHE_HOME=/var/cache/coastarc" in environment
    for name, service in SERVICES.items():
        places = [volume.partition(":")[2] for volume in service["volumes"]]
        assert service["read_only"] and {volume.partition(":")[0] for volume in service["volumes"]} <= set(
            COMPOSE["volumes"]
        )
        if name != "database":
            assert set(places) <= {"/var/lib/coastarc", "/var/cache/coastarc"}
            assert all(f"{place}" in instructions("RUN")[-1] for place in places)


def test_the_docs_make_every_secret_and_name_every_role_and_profile():
    for secret in COMPOSE["secrets"].values():
        assert secret["file"].removeprefix("./") in DEPLOY
    profiles = {profile for service in SERVICES.values() for profile in service["profiles"]}
    assert profiles == {"sqlite", "postgres", "pool", "ray"}
    assert all(f"`{name}`" in DEPLOY for name in [*profiles, *SERVICES])


def test_the_address_of_the_database_in_the_docs_is_one():
    (address,) = re.findall(r"'(postgresql://[^']+)'", DEPLOY)
    url = database_url(address.replace("%s", "secret"))
    assert (url.host, url.username, url.database) == ("database", "coastarc", "coastarc")
    assert SERVICES["database"]["environment"]["POSTGRES_USER"] == url.username
    assert SERVICES["database"]["environment"]["POSTGRES_DB"] == url.database
