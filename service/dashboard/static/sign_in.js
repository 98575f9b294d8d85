/** The sign-in page has no button for the theme, but applies the chosen one. */

import { theme } from "./theme.js";

document.documentElement.dataset.theme = theme();
