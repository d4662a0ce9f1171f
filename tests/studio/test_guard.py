"""The guard: what another site, a form or a foreign program sends is refused."""

import time

import pytest

from .conftest import HOME, PORT, opened, run_apart


def test_the_page_itself_is_served_and_may_load_nothing_from_elsewhere(page):
    answer = page.client.get("/")
    assert answer.status_code == 200 and "<html" in answer.text
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy
    sources = {word for part in policy.split(";") for word in part.split()[1:]}
    assert sources <= {"'none'", "'self'", "blob:", "data:"}
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize("host", [
    "127.0.0.1", f"127.0.0.1.evil.example:{PORT}", f"evil.example:{PORT}", "evil.example",
    f"127.0.0.1:{PORT + 1}", f"localhost.evil.example:{PORT}", f"user@127.0.0.1:{PORT}", "",
    f"127.1:{PORT}", f"0.0.0.0:{PORT}", f"[::1]:{PORT + 1}", f"2130706433:{PORT}"])
def test_a_name_that_was_made_to_point_here_is_refused(page, host):
    for path in ("/", "/api/state"):
        answer = page.client.get(path, headers={"host": host})
        assert answer.status_code == 403 and "state" not in answer.text[:20]
        assert answer.json()["error"]["code"] == "refused"


@pytest.mark.parametrize("host", [f"localhost:{PORT}", f"[::1]:{PORT}", f"LOCALHOST:{PORT}"])
def test_the_other_names_of_this_machine_are_answered(page, host):
    assert page.client.get("/", headers={"host": host}).status_code == 200


@pytest.mark.parametrize("changed", [
    {"origin": "http://evil.example"}, {"origin": "null"}, {"origin": ""},
    {"origin": f"http://127.0.0.1:{PORT + 1}"}, {"origin": f"https://127.0.0.1:{PORT}"},
    {"origin": f"http://localhost:{PORT}"}, {"origin": None}, {"x-lfportrait": None},
    {"x-lfportrait": "0"}, {"sec-fetch-site": "cross-site"}, {"sec-fetch-site": "same-site"}])
def test_a_write_that_does_not_come_from_the_page_changes_nothing(page, changed):
    headers = {"origin": HOME, "x-lfportrait": "1", "content-type": "application/json", **changed}
    headers = {name: value for name, value in headers.items() if value is not None}
    answer = page.client.post("/api/projects", content=b'{"name": "Anna"}', headers=headers)
    assert answer.status_code == 403
    assert page.get("/api/projects") == {"projects": []}


@pytest.mark.parametrize("kind", ["text/plain", "application/x-www-form-urlencoded",
                                  "multipart/form-data; boundary=x", ""])
def test_what_a_form_can_send_is_not_taken(page, kind):
    answer = page.ask("POST", "/api/projects", {"name": "Anna"}, headers={"content-type": kind})
    assert answer.status_code == 415 and answer.json()["error"]["code"] == "bad_type"
    assert page.get("/api/projects") == {"projects": []}


def test_a_read_from_another_site_is_refused(page):
    for site, status in (("cross-site", 403), ("same-site", 403), ("same-origin", 200),
                         ("none", 200)):
        answer = page.ask("GET", "/api/state", headers={"sec-fetch-site": site})
        assert answer.status_code == status


def test_without_the_key_of_the_run_nothing_is_told(page):
    for cookie in ("", f"{page.keys.name}=", f"{page.keys.name}=wrong", "lfstudio=x"):
        page.client.cookies.clear()
        for method, path in (("GET", "/api/state"), ("GET", "/api/events"),
                             ("POST", "/api/projects"), ("GET", "/view/a/b.html")):
            answer = page.ask(method, path, headers={"cookie": cookie})
            assert answer.status_code == 401 and answer.json()["error"]["code"] == "no_session"


def test_only_the_right_key_is_exchanged_for_a_cookie(page):
    page.client.cookies.clear()
    for body in ({"token": ""}, {"token": page.keys.token[:-1]}, {"token": 1}, {"token": "ü"},
                 [], {}):
        answer = page.ask("POST", "/api/session", body)
        assert answer.status_code == 401 and "set-cookie" not in answer.headers
    cookie = page.ask("POST", "/api/session", {"token": page.keys.token}).headers["set-cookie"]
    words = cookie.lower()
    assert "httponly" in words and "samesite=strict" in words and "path=/" in words
    assert page.keys.token not in cookie


@pytest.mark.parametrize("path", [
    "/static/../app.py", "/static/..%2fapp.py", "/static/%2e%2e/app.py", "/static//etc/passwd",
    "/static/..%5capp.py", "/static/app.py", "/../../etc/passwd", "/static/%00", "/view/../x.html"])
def test_no_file_is_served_but_the_pages_own(page, path):
    answer = page.client.get(path)
    assert answer.status_code in (401, 404), path
    assert "import" not in answer.text and "root:" not in answer.text


@pytest.mark.parametrize("name", ["..", ".", "%2e%2e", "..%2f..%2fetc", "a%2f..%2fb", "anna%00",
                                  "C:", "Anna", "anna.", "ANNA", "anna%0a"])
def test_ids_are_never_paths(page, name):
    (page.desk.projects.folder.parent / "photos").mkdir()
    page.do("POST", "/api/projects", {"name": "anna"})
    answer = page.ask("GET", f"/api/projects/{name}/photos")
    assert answer.status_code == 404


def test_a_large_body_is_refused_before_and_while_it_is_read(page):
    much = b'{"name": "' + b"a" * (1 << 20) + b'"}'
    assert page.ask("POST", "/api/projects", None, content=much).status_code == 413

    def pieces():
        yield much

    answer = page.ask("POST", "/api/projects", None, content=pieces())
    assert answer.status_code == 411  # nothing says how long it is


def test_what_is_longer_than_it_says_is_not_read(page):
    answer = page.ask("POST", "/api/projects", None, content=b"{" + b" " * (1 << 20) + b"}",
                      headers={"content-length": "2"})
    assert answer.status_code == 413
    for length in ("-1", "1e3", "", " 3", "²"):
        answer = page.ask("POST", "/api/projects", None, content=b"{}",
                          headers={"content-length": length.encode("utf-8")})
        assert answer.status_code == 411


def test_bad_json_is_refused_and_deep_json_does_no_harm(page):
    for body in (b"{", b"[]", b'"x"', b"\xff", b"[" * 100_000, b'{"name": ' * 50_000):
        answer = page.ask("POST", "/api/projects", None, content=body)
        assert answer.status_code == 400, body[:20]


def test_a_body_that_does_not_come_is_given_up(tmp_path):
    """Asked directly: the test client sends what it has at once."""
    import asyncio

    from lfportrait.studio.answers import Refusal
    from lfportrait.studio.app import Guard, Keys

    seen = {}

    async def app(scope, receive, send):
        try:
            while (await receive()).get("more_body"):
                pass
        except Refusal as refusal:
            seen["code"] = refusal.code
            seen["after"] = time.monotonic() - begun

    async def never():
        await asyncio.sleep(60)

    async def dripping():
        await asyncio.sleep(0.05)
        return {"type": "http.request", "body": b" ", "more_body": True}

    keys = Keys(PORT)
    cookie = keys.exchanged(keys.token)
    headers = {"host": f"127.0.0.1:{PORT}", "origin": HOME, "x-lfportrait": "1",
               "content-type": "application/json", "content-length": "5",
               "cookie": f"{cookie['key']}={cookie['value']}"}
    scope = {"type": "http", "method": "POST", "path": "/api/projects", "query_string": b"",
             "headers": [(name.encode(), value.encode()) for name, value in headers.items()]}

    async def nothing(message):
        pass

    for receive in (never, dripping):
        seen.clear()
        begun = time.monotonic()
        run_apart(Guard(app, keys, patience=0.3)(scope, receive, nothing))
        assert seen["code"] == "too_slow" and seen["after"] < 30, receive


def test_websockets_are_closed(page):
    from starlette.websockets import WebSocketDisconnect

    with pytest.raises(WebSocketDisconnect) as end, page.client.websocket_connect("/api/events"):
        pass
    assert end.value.code == 1008


def test_a_folder_is_open_in_one_studio_at_a_time(page):
    from lfportrait.errors import UserError

    with pytest.raises(UserError, match="another studio"):
        next(opened(page.desk.projects.folder))


def test_any_title_has_a_folder(page):
    title = "Zo\u00eb \N{WOMAN}\N{ZERO WIDTH JOINER}\N{ARTIST PALETTE} <b> ../../x"
    made = page.do("POST", "/api/projects", {"name": title})
    assert made["name"] == title
    folder = page.desk.projects.get(made["id"]).folder
    assert folder.parent == page.desk.projects.folder and folder.is_dir()
    assert folder.name == "Zo\u00eb \N{WOMAN}-\N{ARTIST PALETTE} -b- ..-..-x"


def test_a_folder_that_can_not_be_written_to_is_said_without_the_command_line(page, monkeypatch):
    project = page.do("POST", "/api/projects", {"name": "Anna"})["id"]

    def refused(*_, **__):
        raise PermissionError(1, "Operation not permitted", "/full/disk")

    monkeypatch.setattr("lfportrait.files.os.open", refused)
    answer = page.ask("PATCH", f"/api/projects/{project}", {"name": "Bob"})
    message = answer.json()["error"]["message"]
    assert message.startswith("can't write") and "Operation not permitted" in message
    assert "--out" not in message and "may be written to" in message


def test_a_removed_sitter_comes_back_and_nothing_else_does(page):
    project = page.do("POST", "/api/projects", {"name": "Anna"})["id"]
    trash = page.do("DELETE", f"/api/projects/{project}", {"confirm": "Anna"})["trash"]
    for wrong in ("../Anna", "/etc", "..", "Bob"):
        assert page.error("POST", "/api/trash", {"name": wrong}) == "not_found"
    page.do("POST", "/api/projects", {"name": "Anna"})
    assert page.do("POST", "/api/trash", {"name": trash})["name"] == "Anna"
    assert {path.name for path in page.desk.projects.folder.iterdir()} >= {"Anna", "Anna-2"}
    assert page.error("POST", "/api/trash", {"name": trash}) == "not_found"
