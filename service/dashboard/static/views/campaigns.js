// @ts-check
/** All campaigns: how far, how well, how long still. */

import { get } from "../api.js";
import { el } from "../dom.js";
import { Page, showEmpty } from "../page.js";

async function refresh() {
  const { items } = await get("/campaigns");
  if (items.length === 0) {
    showEmpty(
      el("h2", {}, "No campaign yet"),
      el("p", {}, "A campaign is a search that you describe in a file. Start one in a terminal and it appears here:"),
      el("pre", {}, "coastarc run examples/quick.toml"),
    );
    return;
  }
  showEmpty();
}

new Page({ events: "/events/stream", refresh }).start();
