"""What all pages share: navigation, themes, the line to the coordinator, the policy of scripts."""


def test_without_a_campaign_the_first_page_says_how_to_start_one(visit, served, tmp_path):
    with served(tmp_path) as (_, url):
        page = visit(url)
        assert "coastarc run examples/quick.toml" in page.inner_text("#empty")
        page.wait_for_selector("#connection[data-connection=live]")
        assert page.get_attribute("nav a[aria-current]", "href") == "/"
        page.close()
