// The page's script. It looks everything up in the data that the page holds, and restates no dynamics.
import "./document.js";
import "./tables.js";
import { byId } from "./elements.js";
import "./sources.js";
import "./map.js";
import { explorer } from "./data.js";
import { asked } from "./address.js";
import { start } from "./controls.js";
import { paintKey } from "./key.js";

if (explorer) {
  start();
  paintKey();
  byId("wait").remove();
  byId("explore").hidden = false;
  if (asked()) byId("explorer").scrollIntoView({ behavior: "instant" });
}
