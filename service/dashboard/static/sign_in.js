/** The sign-in page has no button for the theme, but the one that was chosen. */

import { theme } from "./theme.js";

document.documentElement.dataset.theme = theme();
