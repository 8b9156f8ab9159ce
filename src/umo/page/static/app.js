import { Feed } from "./feed.js";

const feed = new Feed();
feed.start();
